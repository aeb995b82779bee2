use super::super::tests::{N, SHIFT, WAY, cloud, color, pair};
use super::*;

/// The shift found of a cloud that goes `SHIFT`, where it is expected to go `expected`.
fn found(
    expected: Vec3,
    hidden_cameras: usize,
    own_color: impl Fn(usize) -> [f32; 3],
) -> Option<Vec3> {
    let pairs: Vec<Pair> = (0..8).map(|k| pair(k, SHIFT, k < hidden_cameras)).collect();
    let last = cloud();
    let ways = vec![WAY; N];
    let speeds = vec![WAY.length(); N];
    let members: Vec<usize> = (0..N).collect();
    let group = Group {
        members: &members,
        last: &last,
        ways: &ways,
        speeds: &speeds,
    };
    let expected: Vec<Vec3> = last.iter().map(|&place| place + expected).collect();
    group.find(&pairs, own_color, &expected)
}

#[test]
fn what_bounces_is_found_where_it_is() {
    for hidden_cameras in [0, 3] {
        let found = found(WAY, hidden_cameras, color).expect("it is seen");
        assert!(found.distance(SHIFT) < 0.05, "{found} {hidden_cameras}");
    }
}

#[test]
fn what_is_where_it_is_expected_or_in_no_sight_is_left_alone() {
    assert_eq!(found(SHIFT, 0, color), None);
    assert_eq!(found(WAY, 8, color), None, "hidden from all cameras");
    let others = |row: usize| color(row).map(|value| (value + 0.5) % 1.0);
    assert_eq!(found(WAY, 0, others), None, "something else is seen there");
}

#[test]
fn groups_are_of_such_as_go_the_same_way() {
    // Two clouds in one place, one going up and one down.
    let places: Vec<Vec3> = (0..96)
        .map(|i| Vec3::new((i % 7) as f32 * 0.01, 0.0, 1.0))
        .collect();
    let up = |row: usize| row.is_multiple_of(2);
    let ways: Vec<Vec3> = (0..96)
        .map(|row| Vec3::Y * if up(row) { 0.1 } else { -0.1 })
        .collect();
    let rows: Vec<usize> = (0..96).filter(|row| row % 5 > 0).collect();
    let groups = groups(&rows, &places, &ways);
    assert!((2..=rows.len().div_ceil(GROUP)).contains(&groups.len()));
    for group in &groups {
        assert!(
            group.iter().all(|&row| up(row) == up(group[0])),
            "{group:?}"
        );
    }
    let mut all = groups.concat();
    all.sort_unstable();
    assert_eq!(all, rows);
    assert!(super::groups(&[], &places, &ways).is_empty());
    let many: Vec<Vec3> = (0..4_000).map(|i| Vec3::splat(i as f32)).collect();
    let rows: Vec<usize> = (0..4_000).collect();
    assert_eq!(super::groups(&rows, &many, &many).len(), GROUPS);
}
