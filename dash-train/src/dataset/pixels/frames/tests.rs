//! The store against all frames in memory, its budget, its errors.

use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering};

use dash_kernels::Camera;
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::*;

const W: usize = 16;
const H: usize = 12;

/// Recipes of `n` pictures of one shade each, and the folder that holds them.
fn pictures(n: usize) -> (tempfile::TempDir, Vec<Recipe>) {
    let folder = tempfile::tempdir().expect("temporary folder");
    let recipes = (0..n)
        .map(|i| {
            let path = folder.path().join(format!("{i:04}.png"));
            image::RgbImage::from_pixel(W as u32, H as u32, image::Rgb([i as u8; 3]))
                .save(&path)
                .expect("a picture");
            Recipe {
                source: Source::File(path),
                camera: Camera::new(9.0, 9.0, 8.0, 6.0, W, H),
                lens: None,
                size: (W / 2, H / 2),
                has_alpha: false,
                counted: None,
            }
        })
        .collect();
    (folder, recipes)
}

fn frame_bytes() -> u64 {
    (W / 2 * H / 2 * 3) as u64
}

/// A budget with which `n` frames are held beside the work of two threads.
fn budget(recipes: &[Recipe], n: u64) -> u64 {
    2 * (recipes[0].working_bytes() + frame_bytes()) + n * frame_bytes()
}

#[test]
fn frames_are_those_of_their_recipes_in_any_order() {
    let (_folder, recipes) = pictures(40);
    let budget = budget(&recipes, 6);
    let store = FrameStore::new(recipes.clone(), budget, 2).expect("enough");
    let mut rng = Pcg32::seed_from_u64(1);
    for round in 0..6 {
        let mut order: Vec<usize> = (0..40).collect();
        order.shuffle(&mut rng);
        // Announced in full, in part, wrongly, or not at all.
        match round % 4 {
            0 => store.announce(order.clone()),
            1 => store.announce(order[..7].to_vec()),
            2 => store.announce(order.iter().rev().copied().collect()),
            _ => store.announce(Vec::new()),
        }
        for &index in &order {
            let expected = recipes[index].make().expect("a picture");
            assert!(*store.get(index).expect("a picture") == expected);
            assert!(store.held_bytes() <= 6 * frame_bytes());
        }
    }
    let statistics = store.statistics();
    assert_eq!(statistics.asked, 240);
    assert!(statistics.waits <= statistics.asked && statistics.decoded >= 40);
}

/// With the order known and time enough, nothing is waited for but the first frames.
#[test]
fn what_is_announced_is_there_in_time() {
    let (_folder, recipes) = pictures(30);
    let store = FrameStore::new(recipes.clone(), budget(&recipes, 6), 2).expect("enough");
    store.announce((0..30).collect());
    for index in 0..30 {
        // Until it is there, or a minute has passed.
        for _ in 0..60_000 {
            if store.holds(index) {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        store.get(index).expect("a picture");
    }
    let statistics = store.statistics();
    assert_eq!((statistics.waits, statistics.decoded), (0, 30));
}

#[test]
fn many_may_wait_at_once() {
    let (_folder, recipes) = pictures(25);
    let store = FrameStore::new(recipes.clone(), budget(&recipes, 4), 2).expect("enough");
    let right = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for seed in 0..8 {
            let (store, recipes, right) = (&store, &recipes, &right);
            scope.spawn(move || {
                let mut rng = Pcg32::seed_from_u64(seed);
                for _ in 0..50 {
                    let index = rng.random_range(0..25);
                    let image = store.get(index).expect("a picture");
                    let same = *image == recipes[index].make().expect("a picture");
                    right.fetch_add(usize::from(same), Ordering::Relaxed);
                }
            });
        }
    });
    assert_eq!(right.into_inner(), 400);
}

#[test]
fn a_damaged_picture_is_an_error_when_it_is_asked_for_and_only_then() {
    let (folder, recipes) = pictures(10);
    let store = FrameStore::new(recipes.clone(), budget(&recipes, 4), 2).expect("enough");
    let path = folder.path().join("0003.png");
    let bytes = fs::read(&path).expect("there");
    fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    store.announce((0..10).collect());
    for index in 0..10 {
        match store.get(index) {
            Ok(_) => assert_ne!(index, 3),
            Err(error) => {
                assert_eq!(index, 3);
                assert!(error.to_string().contains("0003.png"), "{error}");
            }
        }
    }
    // Mended, it is read.
    fs::write(&path, &bytes).expect("written");
    assert!(store.get(3).is_ok());
}

#[test]
fn a_budget_for_less_than_a_few_frames_is_refused_with_the_least_that_would_do() {
    let (_folder, recipes) = pictures(10);
    let error = FrameStore::new(recipes.clone(), budget(&recipes, 3), 2).expect_err("too little");
    let message = error.to_string();
    let least = bytes_in_words(budget(&recipes, 4));
    assert!(
        message.contains("--memory") && message.contains(&least) && message.contains("--downscale"),
        "{message}"
    );
    assert!(FrameStore::new(recipes.clone(), budget(&recipes, 4), 2).is_ok());
}

#[test]
fn amounts_are_written_as_people_write_them() {
    for (bytes, words) in [
        (17, "17 bytes"),
        (1024, "1.0 KiB"),
        (3 << 29, "1.5 GiB"),
        (5000 << 40, "5000.0 TiB"),
    ] {
        assert_eq!(bytes_in_words(bytes), words);
    }
    assert!(default_budget() > 0);
}
