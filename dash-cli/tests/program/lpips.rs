//! LPIPS from the command line: weights from files into `results.json`.

use std::collections::BTreeMap;

use crate::common::{Scratch, TINY};
use dash_model::parameters::HostTensor;
use dash_model::scene_file::write_tensors;
use dash_train::metrics::lpips::Network;
use serde_json::Value;

/// AlexNet's tensors with regular values.
fn weights() -> BTreeMap<String, HostTensor> {
    let tensors = Network::AlexNet.expected_tensors().into_iter();
    tensors
        .map(|expected| {
            let n_values: usize = expected.shape.iter().product();
            let fan_in = expected.shape[1..].iter().product::<usize>() as f32;
            let is_linear = expected.name.starts_with("lin");
            let values = (0..n_values)
                .map(|index| {
                    let value = ((index * 7919) % 101) as f32 / 101.0;
                    if is_linear {
                        value
                    } else {
                        (value - 0.5) / fan_in.sqrt()
                    }
                })
                .collect();
            let shape = expected.shape;
            (expected.name, HostTensor { shape, values })
        })
        .collect()
}

fn results(scratch: &Scratch) -> Value {
    serde_json::from_slice(&scratch.read("run/results.json")).expect("JSON")
}

#[test]
fn scores_have_lpips_where_weights_are_named_and_pictures_large_enough() {
    let scratch = Scratch::new();
    let all = weights();
    let (linear, features): (BTreeMap<_, _>, BTreeMap<_, _>) = all
        .into_iter()
        .partition(|(name, _)| name.starts_with("lin"));
    write_tensors(&scratch.path("features.safetensors"), &features).expect("written");
    write_tensors(&scratch.path("linear.safetensors"), &linear).expect("written");
    let both = ["--lpips-alex", "features.safetensors", "linear.safetensors"];

    scratch.ok(&[
        "synth",
        "room",
        "--cameras",
        "3",
        "--frames",
        "2",
        "--size",
        "36x32",
    ]);
    let mut train = vec!["train", "room", "--out", "run", "--iterations", "10"];
    train.extend(["--preset", "quick"]);
    train.extend(TINY);
    // Missed before the training: nothing is left behind.
    let mut half = train.clone();
    half.extend(&both[..2]);
    scratch.fails(&half, "lin0.model.1.weight");
    let mut absent = train.clone();
    absent.extend(["--lpips-vgg", "vgg.pth"]);
    scratch.fails(&absent, "vgg.pth");

    train.extend(both);
    let told = scratch.ok(&train);
    assert!(told.contains("LPIPS, AlexNet"), "{told}");
    let trained = results(&scratch);
    let score = trained["lpips_alex"].as_f64().expect("measured");
    assert!(score > 0.0, "{score}");
    assert_eq!(trained["lpips_vgg"], Value::Null);
    let views = trained["per_view"].as_array().expect("views");
    let sum: f64 = views
        .iter()
        .map(|v| v["lpips_alex"].as_f64().expect("measured"))
        .sum();
    assert!((sum / views.len() as f64 - score).abs() < 1e-12);
    assert!(views.iter().all(|view| view["lpips_vgg"].is_null()));
    let rule = trained["metric_settings"]["lpips"].as_str().expect("text");
    assert!(
        rule.contains("AlexNet") && rule.contains("0.1") && rule.contains("[-1, 1]"),
        "{rule}"
    );

    scratch.ok(&["eval", "run"]);
    let without = results(&scratch);
    assert_eq!(without["lpips_alex"], Value::Null);
    assert_eq!(without["psnr"], trained["psnr"]);
    assert_eq!(
        without["metric_settings"]["lpips"],
        "not measured: no weights"
    );

    let mut again = vec!["eval", "run"];
    again.extend(both);
    scratch.ok(&again);
    assert_eq!(results(&scratch)["lpips_alex"], trained["lpips_alex"]);

    let mut train = vec!["train", "room", "--out", "half", "--iterations", "1"];
    train.extend(["--preset", "quick", "--downscale", "2"]);
    train.extend(TINY);
    scratch.ok(&train);
    let told = scratch.ok(&["eval", "half", both[0], both[1], both[2]]);
    assert!(
        told.contains("needs 31x31 pixels; the views have 18x16"),
        "{told}"
    );
}
