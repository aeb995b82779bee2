use super::super::block_matching::tests::{FRAMES, N, SCALE, displaced, trainer};
use super::*;
use crate::train::core::Saved;
use crate::train::extensions::following::Following;
use crate::train::{Trainer, latest_checkpoint, load_checkpoint, save_checkpoint};

/// How far the body goes, so that it goes less than its own width between frames.
const PACE: f32 = 0.2;

/// A small body before a wall, at the end of the warm-up.
fn warmed_up() -> Trainer {
    let mut trainer = trainer(SCALE, PACE);
    // The first step moves the stages of a short run.
    trainer.step().expect("trains");
    trainer.run.step = trainer.run.stages().warmup;
    trainer
}

/// Trains until a step.
fn train(trainer: &mut Trainer, until: usize) {
    while trainer.run.step < until {
        trainer.step().expect("trains");
    }
}

fn flow(trainer: &Trainer) -> Option<&SceneFlow> {
    trainer.hooks.get::<Following>().expect("on").flow.as_ref()
}

#[test]
fn frames_are_visited_from_the_middle_outwards() {
    assert_eq!(outwards(2, 5), [3, 1, 4, 0]);
    assert_eq!(outwards(0, 3), [1, 2]);
    assert_eq!(outwards(3, 4), [2, 1, 0]);
    assert!(outwards(0, 1).is_empty());
}

#[test]
fn a_body_is_registered_to_every_frame_and_keeps_its_trajectory() {
    let mut trainer = warmed_up();
    let handover = trainer.run.stages().handover;
    train(&mut trainer, handover);
    assert!(flow(&trainer).is_none(), "trajectories take over");
    let run = &trainer.run;
    let own = run.scene.static_set.trajectories.as_ref().expect("given");
    for frame in 0..FRAMES {
        let time = frame as f32 / (FRAMES - 1) as f32;
        let moved = run.method.basis.displacement(own.val(), time);
        let moved = to_host(moved.expect("valid"));
        // New Gaussians follow those of the body.
        let mean = moved
            .chunks_exact(3)
            .take(N)
            .map(Vec3::from_slice)
            .sum::<Vec3>()
            / N as f32;
        let place = PACE * displaced(frame);
        assert!(
            mean.distance(place) < 0.04,
            "frame {frame}: {mean}, not {place}"
        );
    }
}

#[test]
fn a_velocity_is_kept_in_part_and_noise_is_not() {
    let run = warmed_up().run;
    let mut flow = SceneFlow::new(&run);
    let way = Vec3::X * 0.1 * flow.width;
    let noise = Vec3::X * 1e-5 * flow.width;
    for (away, place) in [(1.0, 3), (-1.0, 1)] {
        let mut moved = vec![away * way; N];
        moved[0] = away * noise;
        flow.known.insert(place, moved);
    }
    let ahead = flow.expected(&run, 4);
    assert!(ahead[1].distance(way * (1.0 + KEPT_VELOCITY)) < 1e-3 * way.length());
    assert!(ahead[0].distance(noise) < 1e-2 * noise.length());
    // At the first frame on one side, the other side tells.
    flow.known.remove(&1);
    let back = flow.expected(&run, 1);
    assert!(
        back[1].distance(-way * KEPT_VELOCITY) < 1e-3 * way.length(),
        "{}",
        back[1]
    );
}

#[test]
fn the_state_of_gaussians_follows_their_rows() {
    let mut trainer = warmed_up();
    let until = trainer.run.step + 2;
    train(&mut trainer, until);
    let following = trainer.hooks.get_mut::<Following>().expect("on");
    let flow = following.flow.as_mut().expect("begun");
    let before = flow.present.as_ref().expect("a frame").from.clone();
    flow.gather(&[Some(4), None, Some(2)]);
    let present = flow.present.as_ref().expect("a frame");
    assert_eq!(present.from, [before[4], Vec3::ZERO, before[2]]);
    assert_eq!((present.expected.len(), present.moves.len()), (3, 3));
    assert!(flow.known.values().all(|known| known.len() == 3));
}

#[test]
fn a_resumed_run_goes_on_with_the_same_frame_to_the_same_bits() {
    let mut trainer = warmed_up();
    let middle = trainer.run.step + 40;
    train(&mut trainer, middle);
    let folder = tempfile::tempdir().expect("a folder");
    save_checkpoint(&trainer, folder.path(), 1.0).expect("written");
    let path = latest_checkpoint(folder.path())
        .expect("read")
        .expect("just written");
    let dataset = trainer.run.dataset.clone();
    let (mut resumed, _) =
        load_checkpoint(&path, dataset, &burn::tensor::Device::flex()).expect("read");
    resumed.run.region = trainer.run.region;
    train(&mut trainer, middle + 30);
    train(&mut resumed, middle + 30);
    let displacements = |trainer: &Trainer| flow(trainer).expect("on").known.clone();
    assert_eq!(displacements(&trainer), displacements(&resumed));
    let [a, b] = [&trainer, &resumed].map(|t| t.run.scene.static_set.to_rows());
    assert_eq!(a, b);
}

#[test]
fn what_does_not_fit_a_checkpoint_is_refused() {
    let mut trainer = warmed_up();
    let until = trainer.run.step + 3;
    train(&mut trainer, until);
    let saved = flow(&trainer).expect("on").save();
    let restored = |saved: Saved| SceneFlow::restore(&trainer.run, saved).map(|_| ());
    assert_eq!(restored(saved.clone()), Ok(()));
    for name in ["known", "from", "expected", "moves"] {
        let mut damaged = saved.clone();
        let mut values = damaged.take(name).expect("saved");
        values.pop();
        damaged.insert(name, values);
        let error = restored(damaged).expect_err("one number is missing");
        assert!(error.contains(name), "{error}");
    }
}
