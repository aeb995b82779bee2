use super::super::schedule::{Schedule, Timeline, Wanted, schedule};

fn names(n: usize) -> Vec<String> {
    (0..n).map(|index| format!("cam{index}")).collect()
}

/// `n` frames at `fps`, the first at `first` seconds.
fn timeline(first: f64, n: usize, fps: f64, offset: f64) -> Timeline {
    Timeline {
        times: (0..n).map(|frame| first + frame as f64 / fps).collect(),
        rate: (n > 1).then_some(fps),
        offset,
    }
}

fn plan(timelines: &[Timeline], wanted: Wanted) -> Schedule {
    schedule(&names(timelines.len()), timelines, wanted).expect("a common range")
}

#[test]
fn the_common_range_at_the_lowest_rate_and_what_was_cut() {
    let timelines = [timeline(0.0, 100, 30.0, 0.0), timeline(0.0, 40, 30.0, 0.1)];
    let plan = plan(&timelines, Wanted::default());
    // In the rig's time the second camera covers -0.1 .. 1.2 s.
    assert!(
        plan.start.abs() < 1e-9 && (plan.fps - 30.0).abs() < 1e-9,
        "{plan:?}"
    );
    assert_eq!(plan.n_frames, 37);
    assert_eq!(plan.remarks.len(), 1, "{plan:?}");
    for part in [
        "0.000 .. 1.200",
        "cam0 0 at the start and 63 at the end",
        "cam1 3 at the start",
    ] {
        assert!(plan.remarks[0].contains(part), "{part} in {plan:?}");
    }
    assert_eq!(timelines[1].nearest(plan.time(0)), 3);
    assert_eq!(timelines[1].nearest(plan.time(36)), 39);
}

#[test]
fn rates_and_parts_that_are_asked_for() {
    let timelines = [timeline(0.0, 100, 25.0, 0.0), timeline(0.0, 120, 30.0, 0.0)];
    let wanted = Wanted {
        fps: Some(5.0),
        start: Some(1.0),
        end: Some(2.0),
    };
    let planned = plan(&timelines, wanted);
    assert_eq!((planned.start, planned.n_frames), (1.0, 6));
    assert_eq!(timelines[0].nearest(planned.time(3)), 40);
    assert_eq!(timelines[1].nearest(planned.time(3)), 48);
    let planned = plan(&timelines, Wanted::default());
    assert_eq!(planned.n_frames, 100);
    assert!(
        planned
            .remarks
            .iter()
            .any(|remark| remark.contains("25.00 to 30.00")),
        "{planned:?}"
    );
    let planned = plan(
        &timelines,
        Wanted {
            fps: Some(60.0),
            ..Wanted::default()
        },
    );
    assert!(
        planned
            .remarks
            .iter()
            .any(|remark| remark.contains("repeated")),
        "{planned:?}"
    );
}

#[test]
fn single_frames_and_recordings_that_never_meet() {
    let one = [timeline(0.0, 1, 1.0, 0.0), timeline(0.0, 1, 1.0, 0.0)];
    assert_eq!(plan(&one, Wanted::default()).n_frames, 1);
    let apart = [timeline(0.0, 30, 30.0, 0.0), timeline(0.0, 30, 30.0, 5.0)];
    let error = schedule(&names(2), &apart, Wanted::default())
        .expect_err("apart")
        .to_string();
    for part in ["--offsets", "cam0", "cam1"] {
        assert!(error.contains(part), "{part} in {error}");
    }
    let late = Wanted {
        start: Some(10.0),
        ..Wanted::default()
    };
    schedule(&names(1), &apart[..1], late).expect_err("after the end");
    let many = Wanted {
        fps: Some(1e4),
        ..Wanted::default()
    };
    schedule(&names(1), &[timeline(0.0, 2, 0.001, 0.0)], many).expect_err("ten million frames");
}

#[test]
fn a_time_half_way_between_two_frames_takes_the_earlier_one() {
    let timeline = timeline(0.0, 600, 60.0, 0.0);
    let at_24 = plan(
        std::slice::from_ref(&timeline),
        Wanted {
            fps: Some(24.0),
            ..Wanted::default()
        },
    );
    for frame in 0..at_24.n_frames {
        assert_eq!(
            timeline.nearest(at_24.time(frame)),
            5 * frame / 2,
            "{frame}"
        );
    }
}
