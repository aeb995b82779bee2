//! A file of Gaussians in the format of SuperSplat.

/// Two Gaussians with spherical harmonics of degree 1.
pub fn two_gaussians() -> Vec<u8> {
    let properties = |kind: &str, names: &[String]| -> String {
        names
            .iter()
            .map(|name| format!("property {kind} {name}\n"))
            .collect()
    };
    let ranges = ["x y z", "scale_x scale_y scale_z", "r g b"].map(|names| {
        let bounds = ["min_", "max_"].iter();
        let names =
            bounds.flat_map(|bound| names.split(' ').map(move |name| format!("{bound}{name}")));
        names.collect::<Vec<String>>()
    });
    let packed = ["position", "rotation", "scale", "color"].map(|name| format!("packed_{name}"));
    let rest: Vec<String> = (0..9).map(|k| format!("f_rest_{k}")).collect();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement chunk 1\n{}element vertex 2\n{}element sh 2\n{}end_header\n",
        properties("float", &ranges.concat()),
        properties("uint", &packed),
        properties("uchar", &rest)
    );
    let mut bytes = header.into_bytes();
    for bound in 0..18u8 {
        bytes.extend((f32::from(bound) / 3.0 - 2.0).to_le_bytes());
    }
    bytes.extend((0..32u8).map(|byte| byte.wrapping_mul(37)));
    bytes.extend((0..18u8).map(|byte| byte.wrapping_mul(91)));
    bytes
}
