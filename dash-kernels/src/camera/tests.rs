use super::*;

#[test]
fn look_at_puts_the_target_on_the_principal_point_with_up_upwards() {
    let camera = Camera::new(100.0, 110.0, 40.0, 31.0, 80, 60).look_at(
        [1.0, 2.0, -4.0],
        [0.5, 0.0, 3.0],
        [0.0, 1.0, 0.0],
    );
    let ([u, v], depth) = camera.project([0.5, 0.0, 3.0]).expect("in front");
    assert!((u - 40.0).abs() < 1e-9 && (v - 31.0).abs() < 1e-9 && depth > 7.0);
    let ([_, above], _) = camera.project([0.5, 0.3, 3.0]).expect("in front");
    assert!(above < 31.0, "a higher point has a smaller row");
    for (got, expected) in camera.position().iter().zip([1.0, 2.0, -4.0]) {
        assert!((got - expected).abs() < 1e-12);
    }
}

#[test]
fn transforms_give_the_pose_they_were_made_of() {
    let camera =
        Camera::from_fov_y(0.8, 80, 60).look_at([1.0, 2.0, -4.0], [0.5, 0.0, 3.0], [0.0, 1.0, 0.0]);
    let point = [0.3, -0.2, 2.0];
    let there = camera.camera_from_world().transform_point3(point.into());
    assert!(there.abs_diff_eq(camera.transform(point).into(), 1e-12));
    let back = camera.world_from_camera().transform_point3(there);
    assert!(back.abs_diff_eq(point.into(), 1e-12));
    let plain = || Camera::from_fov_y(0.8, 80, 60);
    let of_world = plain().with_camera_from_world(camera.camera_from_world());
    assert_eq!(of_world.expect("a rigid transform"), camera);
    let of_camera = plain()
        .with_world_from_camera(camera.world_from_camera())
        .expect("a rigid transform");
    assert_eq!(of_camera.rotation, camera.rotation);
    let apart = DVec3::from(of_camera.translation) - DVec3::from(camera.translation);
    assert!(apart.length() < 1e-12);
}

#[test]
fn a_pose_that_scales_or_mirrors_or_is_not_finite_is_refused() {
    for transform in [
        DAffine3::from_scale(DVec3::splat(2.0)),
        DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0)),
        DAffine3::from_translation(DVec3::NAN),
        DAffine3::from_scale(DVec3::NAN),
    ] {
        let camera = || Camera::from_fov_y(0.8, 80, 60);
        let refused = camera().with_camera_from_world(transform);
        let message = refused.expect_err("not rigid").to_string();
        assert!(message.contains("camera_from_world"), "{message}");
        assert!(camera().with_world_from_camera(transform).is_err());
    }
}

#[test]
fn the_field_of_view_is_the_angle_between_the_edges() {
    let camera = Camera::from_fov_y(0.8, 80, 60);
    assert!((camera.fov_y_radians() - 0.8).abs() < 1e-12);
    let wide = Camera::from_fov_x(0.8, 80, 60);
    assert!((wide.fov_x_radians() - 0.8).abs() < 1e-12);
    assert_eq!(wide.fx, wide.fy);
    // A principal point off the middle: 45 degrees to the left edge, none to the right one.
    let camera = Camera::new(80.0, 80.0, 80.0, 30.0, 80, 60);
    assert!((camera.fov_x_radians() - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
    let pixel = camera.intrinsics() * DVec3::new(0.3, -0.2, 2.0);
    let ([u, v], depth) = camera.project([0.3, -0.2, 2.0]).expect("in front");
    assert!((pixel / depth).abs_diff_eq(DVec3::new(u, v, 1.0), 1e-12));
}

#[test]
fn a_picture_holds_its_first_row_and_column_and_not_what_is_behind() {
    let camera = Camera::new(2.0, 2.0, 2.0, 1.0, 4, 2);
    assert_eq!(
        camera.project_inside([-1.0, -0.5, 1.0]),
        Some(([0.0, 0.0], 1.0))
    );
    assert_eq!(camera.project_inside([1.0, 0.0, 1.0]), None, "column 4");
    assert_eq!(camera.project_inside([0.0, 0.5, 1.0]), None, "row 2");
    assert_eq!(camera.project_inside([0.0, 0.0, -1.0]), None, "behind");
}

#[test]
fn resized_keeps_rays() {
    let camera = Camera::new(100.0, 110.0, 40.0, 31.0, 80, 60);
    let ([u, v], _) = camera.project([0.3, -0.2, 2.0]).expect("in front");
    let ([u2, v2], _) = camera
        .resized(40, 30)
        .project([0.3, -0.2, 2.0])
        .expect("in front");
    assert!((u / 2.0 - u2).abs() < 1e-12 && (v / 2.0 - v2).abs() < 1e-12);
}
