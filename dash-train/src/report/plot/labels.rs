//! Names beside lines and points, so that none covers another.

/// A rectangle: left, top, right, bottom.
pub(super) type Rectangle = [f64; 4];

/// Whether two rectangles share room.
pub(super) fn overlap(a: Rectangle, b: Rectangle) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Heights near those wanted, in the same order, at least `apart` from each other and within
/// `[top, bottom]` as far as they fit.
pub(super) fn spread_heights(wanted: &[f64], apart: f64, [top, bottom]: [f64; 2]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..wanted.len()).collect();
    order.sort_by(|&a, &b| wanted[a].total_cmp(&wanted[b]));
    let mut heights: Vec<f64> = order.iter().map(|&i| wanted[i]).collect();
    // Neighbours that are too close form a group, centred on the mean of the places they want.
    let mut groups: Vec<(usize, f64)> = Vec::new();
    for &height in &heights {
        groups.push((1, height));
        while let [.., (n, a), (m, b)] = groups[..] {
            let reach = apart * (n + m) as f64 / 2.0;
            if b - a >= reach {
                break;
            }
            let middle = (a * n as f64 + b * m as f64) / (n + m) as f64;
            groups.truncate(groups.len() - 2);
            groups.push((n + m, middle));
        }
    }
    let mut next = 0;
    let mut lowest = top;
    for (n, middle) in groups {
        let extent = apart * (n - 1) as f64;
        let first = (middle - extent / 2.0).min(bottom - extent).max(lowest);
        for k in 0..n {
            heights[next] = first + apart * k as f64;
            next += 1;
        }
        lowest = first + extent + apart;
    }
    let mut out = vec![0.0; wanted.len()];
    for (height, &i) in heights.iter().zip(&order) {
        out[i] = *height;
    }
    out
}

/// The first of the places around `at` where a text of this size covers nothing that is taken; its
/// left end and base line.
pub(super) fn place_beside(
    at: [f64; 2],
    [width, height]: [f64; 2],
    distance: f64,
    bounds: Rectangle,
    taken: &[Rectangle],
) -> Option<([f64; 2], Rectangle)> {
    let [x, y] = at;
    let (d, half) = (distance, height / 2.0);
    let candidates = [
        [x + d, y - half],
        [x - width / 2.0, y - d - height],
        [x - width / 2.0, y + d],
        [x - d - width, y - half],
        [x + 0.7 * d, y - 0.7 * d - height],
        [x + 0.7 * d, y + 0.7 * d],
        [x - 0.7 * d - width, y - 0.7 * d - height],
        [x - 0.7 * d - width, y + 0.7 * d],
    ];
    candidates.into_iter().find_map(|[left, top]| {
        let own = [left, top, left + width, top + height];
        let inside = own[0] >= bounds[0]
            && own[1] >= bounds[1]
            && own[2] <= bounds[2]
            && own[3] <= bounds[3];
        let free = inside && !taken.iter().any(|&other| overlap(own, other));
        free.then_some(([left, top + 0.8 * height], own))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_keep_apart_and_stay_near() {
        let heights = spread_heights(&[50.0, 52.0, 10.0, 51.0], 12.0, [0.0, 100.0]);
        assert_eq!(heights, [39.0, 63.0, 10.0, 51.0]);
        let low = spread_heights(&[99.0, 99.5, 98.0], 12.0, [0.0, 100.0]);
        assert_eq!(low, [88.0, 100.0, 76.0]);
        assert_eq!(spread_heights(&[], 12.0, [0.0, 1.0]), [0.0; 0]);
        let crowded = spread_heights(&[5.0; 9], 12.0, [0.0, 50.0]);
        assert!(
            crowded
                .windows(2)
                .all(|pair| pair[1] - pair[0] >= 12.0 - 1e-9)
        );
    }

    #[test]
    fn a_name_goes_where_there_is_room() {
        let bounds = [0.0, 0.0, 100.0, 100.0];
        let size = [30.0, 10.0];
        let place = |at, taken: &[Rectangle]| place_beside(at, size, 6.0, bounds, taken);
        let (_, free) = place([50.0, 50.0], &[]).expect("room");
        assert_eq!(free, [56.0, 45.0, 86.0, 55.0]);
        let (_, beside) = place([50.0, 50.0], &[free]).expect("room above");
        assert!(!overlap(free, beside));
        let (_, at_border) = place([95.0, 50.0], &[]).expect("room to the left");
        assert!(at_border[2] <= 100.0);
        assert_eq!(place([50.0, 50.0], &[bounds]), None);
    }
}
