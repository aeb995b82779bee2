use std::collections::BTreeSet;

use super::*;
use crate::cube::tests::{cube_tensor, words};

/// A diagonal ellipse over most of 5 by 5 tiles, four times; `expand` finds others than were counted.
#[test]
fn as_many_tiles_are_listed_as_were_counted() {
    let (n, tiles) = (4, 6);
    let row = [
        48.0, 48.0, 0.05, -0.045, 0.05, 0.9, 1.0, 1.0, 1.0, 2.0, 36.0, 36.0, 0.0, 0.0, 0.0, 0.0,
    ];
    let splats = cube_tensor(&row.repeat(n), [n, N_COLUMNS]);
    let client = &splats.client;
    let image = || ImageSizeLaunch::new(16 * tiles, 16 * tiles, tiles);
    let new = |length| Buffer::uninitialised(client, length);
    let (keys, ids, found, ranges) = (new(n), new(n), new(n), new(9));
    let (count, dim) = units(client, n);
    find_tiles::launch(
        client,
        count.clone(),
        dim,
        arg(&splats),
        keys.arg(),
        ids.arg(),
        found.arg(),
        ranges.arg(),
        image(),
        n as u32,
        9,
    );
    assert_eq!(words(client, &ranges), [0; 9]);
    let found = words(client, &found)[0];
    assert!((9..=23).contains(&found), "{found} of 25 tiles");

    let counted = [found, found - 1, found + 2, found];
    let counts = Buffer::from_words(client, &counted);
    let starts = exclusive_scan(client, &counts);
    let total = counted.iter().sum::<u32>();
    let lists = [(); 3].map(|()| new(total as usize));
    let [tile_keys, slots, slot_rows] = &lists;
    expand::launch(
        client,
        count,
        dim,
        arg(&splats),
        Buffer::from_words(client, &[0, 1, 2, 3]).arg(),
        counts.arg(),
        starts.arg(),
        ExpandedLaunch::new(tile_keys.arg(), slots.arg(), slot_rows.arg()),
        image(),
        n as u32,
        total,
    );
    let [tile_keys, slots, slot_rows] = lists.map(|list| words(client, &list));
    assert!(slots.into_iter().eq(0..total));
    let mut from = 0;
    let listed = counted.map(|count| {
        let to = from + count as usize;
        let tiles: BTreeSet<u32> = tile_keys[from..to].iter().copied().collect();
        from = to;
        assert_eq!(tiles.len(), count as usize, "a tile twice");
        tiles
    });
    let rows = (0..)
        .zip(counted)
        .flat_map(|(row, count)| (0..count).map(move |_| row));
    assert!(slot_rows.into_iter().eq(rows));
    assert!(listed[1].is_subset(&listed[0]) && listed[0].is_subset(&listed[2]));
    assert_eq!(listed[0], listed[3]);
    assert!(listed[2].iter().all(|tile| *tile < 36));
}
