//! Cameras, and the files of poses that hold them.

use dash_kernels::Camera;

use super::fixture::{Fixture, H, W};

/// A camera in general position, looking at the origin.
pub(crate) fn camera(index: usize) -> Camera {
    let angle = 0.7 * index as f64;
    let eye = [
        3.0 * angle.cos(),
        0.5 + 0.2 * index as f64,
        3.0 * angle.sin(),
    ];
    Camera::new(9.0, 9.0, W as f64 / 2.0, H as f64 / 2.0, W, H).look_at(
        eye,
        [0.0; 3],
        [0.0, 1.0, 0.0],
    )
}

/// The camera's axis (right, down, forward: 0, 1, 2) in the world.
pub(crate) fn axis(camera: &Camera, index: usize) -> [f64; 3] {
    camera.rotation[index]
}

pub(crate) fn negated(v: [f64; 3]) -> [f64; 3] {
    v.map(|c| -c)
}

/// The rotation as a quaternion (w, x, y, z).
pub(crate) fn quaternion(camera: &Camera) -> [f64; 4] {
    let rows = glam::DMat3::from_cols_array_2d(&camera.rotation);
    let q = glam::DQuat::from_mat3(&rows.transpose());
    [q.w, q.x, q.y, q.z]
}

#[track_caller]
pub(crate) fn assert_cameras_equal(got: &Camera, expected: &Camera) {
    assert_eq!((got.width, got.height), (expected.width, expected.height));
    let numbers = |c: &Camera| {
        let mut all: Vec<f64> = c.rotation.iter().flatten().copied().collect();
        all.extend(c.translation);
        all.extend([c.fx, c.fy, c.cx, c.cy]);
        all
    };
    for (index, (g, e)) in numbers(got).into_iter().zip(numbers(expected)).enumerate() {
        assert!(
            (g - e).abs() < 1e-9,
            "number {index}: got {g}, expected {e}"
        );
    }
}

/// Writes a COLMAP text model of these images and one point.
pub(crate) fn write_model(fixture: &Fixture, folder: &str, images: &[(&str, Camera)]) {
    let (mut cameras, mut poses) = (String::from("# Cameras\n"), String::from("# Images\n"));
    for (index, (name, camera)) in images.iter().enumerate() {
        let id = index + 1;
        let Camera {
            fx,
            fy,
            cx,
            cy,
            width,
            height,
            ..
        } = camera;
        cameras += &format!("{id} PINHOLE {width} {height} {fx} {fy} {cx} {cy}\n");
        let numbers = quaternion(camera).into_iter().chain(camera.translation);
        let pose: Vec<String> = numbers.map(|v| v.to_string()).collect();
        poses += &format!("{id} {} {id} {name}\n\n", pose.join(" "));
    }
    fixture.write(&format!("{folder}/cameras.txt"), cameras);
    fixture.write(&format!("{folder}/images.txt"), poses);
    fixture.write(&format!("{folder}/points3D.txt"), "1 1 2 3 4 5 6 0.5\n");
}

/// A version 1.0 file with this header dictionary.
pub(crate) fn npy(dictionary: &str, values: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((dictionary.len() as u16).to_le_bytes());
    bytes.extend(dictionary.as_bytes());
    bytes.extend(values);
    bytes
}

pub(crate) fn npy_f64(rows: &[[f64; 17]]) -> Vec<u8> {
    let header = format!(
        "{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, 17), }}\n",
        rows.len()
    );
    let values: Vec<u8> = rows
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    npy(&header, &values)
}
