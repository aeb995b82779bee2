//! LPIPS's tensors by the names that published files use.

use super::super::architecture::linear_name;

/// The name among [`super::super::Network::expected_tensors`] of a file's tensor `key`; `None` for a tensor that
/// LPIPS doesn't use.
pub(super) fn expected_name(key: &str) -> Option<String> {
    let parts: Vec<&str> = key.split('.').collect();
    match parts[..] {
        ["features", index, kind @ ("weight" | "bias")] => feature(index, kind),
        // A saved LPIPS cuts torchvision's features into slices, and keeps their indices.
        ["net", slice, index, kind @ ("weight" | "bias")] => {
            let slice = slice.strip_prefix("slice")?;
            matches!(slice, "1" | "2" | "3" | "4" | "5")
                .then(|| feature(index, kind))
                .flatten()
        }
        // The position is 0 in an LPIPS without dropout in front of its weights.
        [linear, "model", "0" | "1", "weight"] => {
            Some(linear_name(number(linear.strip_prefix("lin")?)?))
        }
        ["lins", index, "model", "0" | "1", "weight"] => Some(linear_name(number(index)?)),
        _ => None,
    }
}

fn feature(index: &str, kind: &str) -> Option<String> {
    number(index).map(|index| format!("features.{index}.{kind}"))
}

/// A number as it is written in names: digits, no leading zero.
fn number(text: &str) -> Option<usize> {
    let value: usize = text.parse().ok()?;
    (value.to_string() == text).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_published_name_is_known_and_nothing_else() {
        for (key, expected) in [
            ("features.0.weight", "features.0.weight"),
            ("features.28.bias", "features.28.bias"),
            ("net.slice1.0.weight", "features.0.weight"),
            ("net.slice5.28.bias", "features.28.bias"),
            ("lin0.model.1.weight", "lin0.model.1.weight"),
            ("lin4.model.0.weight", "lin4.model.1.weight"),
            ("lins.3.model.1.weight", "lin3.model.1.weight"),
        ] {
            assert_eq!(expected_name(key).as_deref(), Some(expected), "{key}");
        }
        for key in [
            "",
            ".",
            "classifier.0.weight",
            "scaling_layer.shift",
            "features.x.weight",
            "features.00.weight",
            "features.0.running_mean",
            "net.slice6.0.weight",
            "net.slice.0.weight",
            "lin.model.1.weight",
            "lin0.model.2.weight",
            "lin0.model.1.bias",
        ] {
            assert_eq!(expected_name(key), None, "{key}");
        }
    }
}
