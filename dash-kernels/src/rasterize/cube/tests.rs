//! What only this backend has: lists of tiles, their overflow, several ways to the same result.

use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::cube::tests::{cube_tensor, cube_values, words};
use crate::rasterize::reference;
use crate::rasterize::tests::{background, cotangents, mask_thresholds, options, random};
use crate::rasterize::tiles::TILE;
use crate::splats::{self, ALPHA_MIN};
use crate::testing::*;

use super::*;

const SIZE: [usize; 2] = [97, 61];
/// Image against image in f32: the order of a pixel's sums is the same whatever the way.
const SAME_IMAGE: f64 = 1e-6;
/// Difference of gradients, relative to their norm: the order of sums differs.
const SAME_GRADIENT: f64 = 1e-5;

fn tuning() -> Tuning {
    Tuning::of(&cube_tensor(&[0.0], [1]).client)
}

/// Image and gradient.
fn run(splats: &[f32], v_image: &[f32], tuning: Tuning) -> (Vec<f32>, Vec<f32>) {
    let n = splats.len() / N_COLUMNS;
    let splats = cube_tensor(splats, [n, N_COLUMNS]);
    let (image, saved) = rasterize_with(splats, options(SIZE[0], SIZE[1]), tuning);
    let v_image = cube_tensor(v_image, [SIZE[1], SIZE[0], N_CHANNELS]);
    let v_splats = CubeBackend::rasterize_vjp(saved, v_image);
    (cube_values(&image), cube_values(&v_splats))
}

#[track_caller]
fn assert_same(name: &str, got: &(Vec<f32>, Vec<f32>), expected: &(Vec<f32>, Vec<f32>)) {
    assert_close(name, &to_f64(&got.0), &to_f64(&expected.0), SAME_IMAGE, 0.0);
    assert_finite(name, &got.1);
    let (got, expected) = (to_f64(&got.1), to_f64(&expected.1));
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let off = norm(&mut got.iter().zip(&expected).map(|(a, b)| a - b));
    let all = norm(&mut expected.iter().copied());
    assert!(
        off <= SAME_GRADIENT * all,
        "{name}: gradients differ by {off:e} of {all:e}"
    );
}

/// Each tile's list has the splats that reach a pixel of it, none that reach no point of it, and
/// has them by depth.
#[test]
fn lists_hold_what_overlaps_in_drawing_order() {
    let splats = random(31, 900, SIZE[0], SIZE[1]);
    let wide = to_f64(&splats);
    let tensor = cube_tensor(&splats, [900, N_COLUMNS]);
    let lists = Intersections::new(&tensor, &options(SIZE[0], SIZE[1]), None);
    let rows = words(&tensor.client, &lists.rows);
    let ranges = words(&tensor.client, &lists.ranges);
    let sigma = |row: &[f64], x: f64, y: f64| {
        let (dx, dy) = (row[splats::MEAN_X] - x, row[splats::MEAN_Y] - y);
        0.5 * (row[splats::CONIC_A] * dx * dx + row[splats::CONIC_C] * dy * dy)
            + row[splats::CONIC_B] * dx * dy
    };
    let (mut listed, mut needed) = (0, 0);
    for tile in 0..lists.tiles[0] * lists.tiles[1] {
        let list = &rows[ranges[2 * tile] as usize..ranges[2 * tile + 1] as usize];
        listed += list.len();
        let depth = |row: u32| splats[row as usize * N_COLUMNS + splats::DEPTH];
        for pair in list.windows(2) {
            let order = (depth(pair[0]), pair[0]) < (depth(pair[1]), pair[1]);
            assert!(order, "tile {tile}: rows {pair:?} are out of order");
        }
        let left = tile % lists.tiles[0] * TILE;
        let top = tile / lists.tiles[0] * TILE;
        for (row, values) in wide.chunks_exact(N_COLUMNS).enumerate() {
            let cut = (values[splats::OPACITY] / ALPHA_MIN).ln();
            let centres = |from: usize, size: usize, step: usize| {
                (from * step..(from + TILE).min(size) * step).map(move |i| (i, step))
            };
            let smallest = |step: usize| {
                let mut smallest = f64::INFINITY;
                for (y, _) in centres(top, SIZE[1], step) {
                    for (x, _) in centres(left, SIZE[0], step) {
                        let place = |i: usize| (i as f64 + 0.5) / step as f64;
                        smallest = smallest.min(sigma(values, place(x), place(y)));
                    }
                }
                smallest
            };
            let is_listed = list.contains(&(row as u32));
            let culled = values[splats::RADIUS_X] <= 0.0;
            if !culled && smallest(1) < cut - 1e-4 {
                needed += 1;
                assert!(is_listed, "tile {tile} lacks row {row}");
            }
            // Points four times as dense and a margin stand for the whole tile.
            if is_listed {
                assert!(
                    smallest(4) < cut + 0.7,
                    "tile {tile} has row {row}, which is far away"
                );
            }
        }
    }
    assert!(
        listed < needed + needed / 10,
        "{listed} listed, {needed} needed"
    );
}

/// Cubes of 16, 32 and 64 units, for subgroups of any width.
#[test]
fn every_cube_size_gives_the_same() {
    let splats = random(32, 500, SIZE[0], SIZE[1]);
    let v_image = to_f32(&cotangents(32, SIZE[0] * SIZE[1]));
    let expected = run(&splats, &v_image, tuning());
    for units in [16, 32, 64] {
        let got = run(&splats, &v_image, Tuning { units, ..tuning() });
        assert_same(&format!("{units} units"), &got, &expected);
    }
}

/// Slots that don't fit one buffer are gone over in windows, in the same order.
#[test]
fn windows_of_slots_change_no_bit() {
    let splats = random(37, 300, SIZE[0], SIZE[1]);
    let v_image = to_f32(&cotangents(37, SIZE[0] * SIZE[1]));
    let whole = Tuning {
        capacity: Some(1 << 14),
        ..tuning()
    };
    let expected = run(&splats, &v_image, whole);
    assert!(expected.1.iter().any(|&v| v != 0.0));
    for slots_per_window in [517, 4096] {
        let got = run(
            &splats,
            &v_image,
            Tuning {
                slots_per_window,
                ..whole
            },
        );
        assert!(got == expected, "windows of {slots_per_window}");
    }
    // Without room for the lists there are no slots, whatever the windows.
    let short = Tuning {
        slots_per_window: 40,
        capacity: Some(100),
        ..whole
    };
    assert_same("overflow", &run(&splats, &v_image, short), &expected);
}

/// Lists that are too short are noticed on the device, and the result is right all the same, with
/// and without atomic addition of floats.
#[test]
fn an_overflow_changes_nothing() {
    let mut splats = random(33, 500, SIZE[0], SIZE[1]);
    // A row that draws nothing must not be drawn by the slow way either.
    splats[5 * N_COLUMNS + splats::RADIUS_X] = 0.0;
    let v_image = to_f32(&cotangents(33, SIZE[0] * SIZE[1]));
    let expected = run(&splats, &v_image, tuning());
    for native_add in [tuning().native_add, false] {
        for capacity in [1, 100] {
            let short = Tuning {
                native_add,
                capacity: Some(capacity),
                ..tuning()
            };
            let got = run(&splats, &v_image, short);
            assert_same(
                &format!("room for {capacity}, {native_add}"),
                &got,
                &expected,
            );
        }
    }
}

#[test]
fn repetitions_have_the_same_bits() {
    let splats = random(34, 800, SIZE[0], SIZE[1]);
    let v_image = to_f32(&cotangents(34, SIZE[0] * SIZE[1]));
    let first = run(&splats, &v_image, tuning());
    for _ in 0..3 {
        assert!(
            run(&splats, &v_image, tuning()) == first,
            "another run differs"
        );
    }
}

/// The capacity that a picture of `n` splats which cover all of it is drawn with, and what it needs.
fn covered(n: usize, size: [usize; 2]) -> [usize; 2] {
    let splats: Vec<f32> = random(35, n, SIZE[0], SIZE[1])
        .chunks_exact(N_COLUMNS)
        .flat_map(|row| {
            let mut row = row.to_vec();
            row[splats::CONIC_A..=splats::CONIC_C].copy_from_slice(&[1e-9, 0.0, 1e-9]);
            row[splats::OPACITY] = 0.02;
            row[splats::RADIUS_X..=splats::RADIUS_Y].fill(1e4);
            row
        })
        .collect();
    let splats = cube_tensor(&splats, [n, N_COLUMNS]);
    let (_, saved) = rasterize_with(splats, options(size[0], size[1]), tuning());
    let needed = words(&saved.splats.client, &saved.intersections.starts)[n] as usize;
    assert_eq!(needed, n * size[0].div_ceil(TILE) * size[1].div_ceil(TILE));
    [saved.intersections.capacity, needed]
}

#[test]
fn the_first_picture_of_a_size_has_room() {
    let [capacity, needed] = covered(20, [1007, 1000]);
    assert!(needed > 1 << 16, "{needed} fit anyway");
    assert!(capacity >= needed, "room for {capacity} of {needed}");
}

/// The capacity follows the need of frames, also where large and small frames alternate.
#[test]
fn capacity_grows() {
    let size = [1000, 1000];
    let [small, _] = covered(1, size);
    let n = 2 * small / (63 * 63) + 1;
    let grown = (0..40).any(|_| {
        covered(1, size);
        let [capacity, needed] = covered(n, size);
        capacity >= needed
    });
    assert!(grown, "still no room for {n} splats");
}

/// Every poison in every column, all rows at once: nothing that is not finite comes out, and rows
/// that are in order are drawn as if the others were not there.
#[test]
fn poison_in_every_column() {
    let good = random(36, 60, SIZE[0], SIZE[1]);
    let mut splats = good.clone();
    for column in 0..N_COLUMNS {
        for value in poison() {
            let at = splats.len();
            splats.extend_from_within(..N_COLUMNS);
            splats[at + column] = value;
        }
    }
    let mut v_image = cotangents(36, SIZE[0] * SIZE[1]);
    let (image, v_splats) = run(&splats, &to_f32(&v_image), tuning());
    assert_finite("image", &image);
    assert_finite("gradient", &v_splats);

    // The rows that no backend draws, beside good ones.
    let mut undrawn = good.clone();
    for column in 0..N_COLUMNS {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let at = undrawn.len();
            undrawn.extend_from_within(..N_COLUMNS);
            undrawn[at + column] = value;
        }
    }
    mask_thresholds(&to_f64(&good), SIZE, &mut v_image);
    let (image, v_splats) = run(&undrawn, &to_f32(&v_image), tuning());
    let expected = reference::rasterize(&to_f64(&good), SIZE, background());
    for (i, &v) in v_image.iter().enumerate() {
        let error = (f64::from(image[i]) - expected[i]).abs();
        assert!(
            v == 0.0 || error < 2e-5,
            "value {i}: {} != {}",
            image[i],
            expected[i]
        );
    }
    assert!(
        v_splats[good.len()..].iter().all(|&v| v == 0.0),
        "an undrawn row has a gradient"
    );
}

/// Some drivers end a loop after 65,535 rounds: the splat behind so many others is drawn all the
/// same, and has its gradient.
#[test]
fn long_lists_are_walked_to_their_end() {
    let n = 70_000;
    let mut splats = Vec::with_capacity((n + 1) * N_COLUMNS);
    for i in 0..n {
        // A pixel wide, in the corner of the tile.
        let depth = 1.0 + i as f32 / n as f32;
        splats.extend([0.5, 0.5, 9.0, 0.0, 9.0, 0.5, 1.0, 0.0, 0.0, depth, 1.0, 1.0]);
        splats.extend([0.0; 4]);
    }
    splats.extend([
        8.0, 8.0, 1e-6, 0.0, 1e-6, 0.5, 0.0, 0.0, 1.0, 3.0, 99.0, 99.0,
    ]);
    splats.extend([0.0; 4]);
    let tensor = cube_tensor(&splats, [n + 1, N_COLUMNS]);
    let (image, saved) = rasterize_with(tensor, options(16, 16), tuning());
    let image = cube_values(&image);
    let far_corner = &image[255 * N_CHANNELS..];
    assert!(
        (far_corner[3] - 0.5).abs() < 1e-4,
        "alpha {}",
        far_corner[3]
    );
    let v_image = cube_tensor(&vec![1.0; image.len()], [16, 16, N_CHANNELS]);
    let v_splats = cube_values(&CubeBackend::rasterize_vjp(saved, v_image));
    let v_blue = v_splats[n * N_COLUMNS + splats::BLUE];
    // Half of every pixel but those by the corner, where some splats before it reach.
    assert!((v_blue - 0.5 * 255.0).abs() < 2.0, "{v_blue}");
}

/// On wgpu a number on its way keeps a thread in the driver, where a program that ends meanwhile may crash.
#[test]
fn a_number_of_intersections_arrives_without_another_frame() {
    // Tiles that no other test has so many of.
    let [width, height] = [9 * TILE + 1, 3 * TILE + 1];
    let splats = random(33, 200, width, height);
    let frame = || {
        let splats = cube_tensor(&splats, [200, N_COLUMNS]);
        rasterize_with(splats, options(width, height), tuning()).0
    };
    let images: Vec<_> = (0..3).map(|_| frame()).collect();
    if images[0].client.name().starts_with("wgpu") {
        let patience = Duration::from_secs(60);
        let start = Instant::now();
        while capacity::is_on_its_way([10, 4]) {
            assert!(start.elapsed() < patience, "nobody takes the number");
            sleep(Duration::from_millis(1));
        }
    }
    let image = cube_values(&images[0]);
    assert!(images.iter().all(|other| cube_values(other) == image));
}
