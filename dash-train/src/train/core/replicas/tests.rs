use std::sync::Arc;
use std::thread;

use burn::tensor::Device;
use dash_model::parameters::named_parameters;
use rand_pcg::Pcg64;

use super::{Exchange, Threads};
use crate::Error;
use crate::dataset::{Dataset, View};
use crate::synth;
use crate::train::config::tests::small;
use crate::train::core::Set;
use crate::train::trainer::Additions;
use crate::train::{StepReport, TrainConfig, Trainer};

const STEPS: usize = 60;

/// All that replicas have in common, with floats as bits.
#[derive(Debug, PartialEq)]
struct State {
    parameters: Vec<(String, Vec<u32>)>,
    statistics: Vec<u32>,
    reports: Vec<[u32; 2]>,
    counts: (usize, usize),
    rng: Pcg64,
}

fn bits(values: impl IntoIterator<Item = f32>) -> Vec<u32> {
    values.into_iter().map(f32::to_bits).collect()
}

fn trainer(
    dataset: &Arc<Dataset>,
    views: usize,
    exchange: Option<Box<dyn Exchange>>,
) -> Result<Trainer, Error> {
    let [views, steps] = [format!("batch={views}"), format!("iterations={STEPS}")];
    let config: TrainConfig = small(&[&views, &steps, "densify.interval=10"]);
    let additions = Additions {
        exchange,
        ..Default::default()
    };
    Trainer::with(config, dataset.clone(), &Device::flex(), additions)
}

fn trained(dataset: &Arc<Dataset>, views: usize, exchange: Option<Box<dyn Exchange>>) -> State {
    let mut trainer = trainer(dataset, views, exchange).expect("valid");
    let mut statistics = Vec::new();
    let mut reports = Vec::new();
    while !trainer.is_finished() {
        let StepReport { loss, psnr, .. } = trainer.step().expect("trains");
        reports.push([loss.to_bits(), psnr.to_bits()]);
        for set in Set::BOTH {
            let (sums, views) = trainer.run.state(set).gathered.totals();
            statistics.extend(bits(sums.into_iter().chain(views)));
        }
    }
    let parameters = named_parameters(trainer.scene()).into_iter();
    State {
        parameters: parameters
            .map(|(name, tensor)| (name, bits(tensor.values)))
            .collect(),
        statistics,
        reports,
        counts: trainer.scene().counts(),
        rng: trainer.run.rng,
    }
}

/// The state of each of so many replicas, which draw so many views a step together.
fn replicated(dataset: &Arc<Dataset>, views: usize, replicas: usize) -> Vec<State> {
    let replicas = Threads::replicas(replicas).into_iter().map(|replica| {
        let dataset = dataset.clone();
        thread::spawn(move || trained(&dataset, views, Some(Box::new(replica))))
    });
    let replicas: Vec<_> = replicas.collect();
    let states = replicas.into_iter().map(|replica| replica.join());
    states.map(|state| state.expect("trains")).collect()
}

fn clip(keep: impl Fn(&View) -> bool) -> Arc<Dataset> {
    let mut dataset = synth::loaded(6, 6, [32, 24]);
    dataset.views.retain(keep);
    Arc::new(dataset)
}

#[test]
fn replicas_have_the_bits_of_one_process_with_as_many_views_a_step() {
    let rig = clip(|_| true);
    let monocular = clip(|view| view.camera_index == view.frame * 5 % 6);
    for (dataset, views, replicas) in [(&rig, 2, 2), (&rig, 5, 3), (&monocular, 2, 2)] {
        let alone = trained(dataset, views, None);
        assert!(alone.counts.1 > 0, "nothing moves");
        assert_ne!(alone.counts.0 + alone.counts.1, 300, "no density control");
        for (rank, state) in replicated(dataset, views, replicas).into_iter().enumerate() {
            assert!(
                state == alone,
                "replica {rank} of {replicas}, {views} views"
            );
        }
    }
}

#[test]
fn a_replica_does_not_wait_for_one_that_has_stopped() {
    let rig = clip(|_| true);
    let [first, second] = Threads::replicas(2).try_into().ok().expect("two");
    let mut first = trainer(&rig, 2, Some(Box::new(first))).expect("valid");
    drop(second);
    let error = first.step().expect_err("the other is gone").to_string();
    assert!(error.contains("another replica has stopped"), "{error}");
}

#[test]
fn a_replica_of_another_run_is_refused() {
    let rig = clip(|_| true);
    let replicas = Threads::replicas(2)
        .into_iter()
        .zip([0, 1])
        .map(|(replica, seed)| {
            let rig = rig.clone();
            thread::spawn(move || {
                let seed = format!("seed={seed}");
                let config = small(&["batch=2", "iterations=60", &seed]);
                let additions = Additions {
                    exchange: Some(Box::new(replica)),
                    ..Default::default()
                };
                let mut trainer =
                    Trainer::with(config, rig, &Device::flex(), additions).expect("valid");
                (0..STEPS)
                    .find_map(|_| trainer.step().err())
                    .map(|error| error.to_string())
            })
        });
    let replicas: Vec<_> = replicas.collect();
    for replica in replicas {
        let told = replica.join().expect("no panic").expect("another seed");
        assert!(told.starts_with("replicas: "), "{told}");
    }
}

#[test]
fn every_replica_needs_a_view_of_each_step() {
    let rig = clip(|_| true);
    let replica = Threads::replicas(3).pop().expect("three");
    let refused = trainer(&rig, 2, Some(Box::new(replica)));
    let error = refused.err().expect("too few views").to_string();
    assert!(error.contains("`batch` = 2"), "{error}");
}
