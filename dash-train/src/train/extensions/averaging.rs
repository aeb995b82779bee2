//! Weight averaging: the mean of the parameters over the last steps of a run. Each step follows one view, and their mean
//! lies nearer to what all views agree on than any one of them does (Polyak and Juditsky 1992; Izmailov et al. 2018).

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor, TensorData};
use dash_model::DynamicScene;
use dash_model::parameters::{HostTensor, Path, named_parameters};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::train::core::{Extension, Method, Ranges, Run, Saved, Section, Set, to_host};

/// Steps between two that count: neighbours hardly differ.
const INTERVAL: usize = 10;

/// The running mean of a scene's parameters.
#[derive(Default)]
struct Average {
    /// How many steps it is of.
    n_steps: usize,
    means: BTreeMap<String, Tensor<1>>,
}

impl Average {
    /// Takes in the parameters as they are.
    fn add(&mut self, scene: &DynamicScene) {
        self.n_steps += 1;
        scene.visit(&mut Adder {
            path: Path::default(),
            average: self,
        });
    }

    /// The scene with the means in place of its parameters; unchanged where there are none.
    fn of(self, scene: DynamicScene) -> DynamicScene {
        if self.n_steps == 0 {
            return scene;
        }
        scene.map(&mut Replacer {
            path: Path::default(),
            means: self.means,
        })
    }

    /// The means, for a checkpoint.
    fn to_tensors(&self) -> BTreeMap<String, HostTensor> {
        let means = self.means.iter().map(|(name, mean)| {
            let values = to_host(mean.clone());
            let shape = vec![values.len()];
            (name.clone(), HostTensor { shape, values })
        });
        means.collect()
    }

    /// The state of [`Average::to_tensors`], of a scene like this.
    ///
    /// # Errors
    /// What does not fit the scene.
    fn from_tensors(
        n_steps: usize,
        tensors: BTreeMap<String, HostTensor>,
        scene: &DynamicScene,
        device: &Device,
    ) -> Result<Self, String> {
        let sizes = |tensors: &BTreeMap<String, HostTensor>| -> Vec<(String, usize)> {
            let sizes = tensors.iter().filter(|(_, t)| !t.values.is_empty());
            sizes
                .map(|(name, t)| (name.clone(), t.values.len()))
                .collect()
        };
        let (expected, found) = (sizes(&named_parameters(scene)), sizes(&tensors));
        if let Some((name, n)) = expected.iter().find(|entry| !found.contains(entry)) {
            return Err(format!("no {n} means of `{name}`"));
        }
        if found.len() > expected.len() {
            return Err("means of parameters that the scene does not have".into());
        }
        let upload = |(name, tensor): (String, HostTensor)| {
            let data = TensorData::new(tensor.values, tensor.shape);
            (name, Tensor::from_data(data, device))
        };
        let means = tensors.into_iter().map(upload).collect();
        Ok(Self { n_steps, means })
    }
}

/// `[extensions.averaging]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AveragingConfig {
    /// Share of the run, at its end, over whose steps the mean is taken; not before density control is over. In these
    /// steps no Gaussian comes, goes or changes sets. Source: ours; 3DGS takes the last step.
    pub share: f32,
}

impl Section for AveragingConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.share("share", self.share);
    }
}

/// See [`AveragingConfig`].
pub struct Averaging {
    config: AveragingConfig,
    average: Average,
}

impl Averaging {
    /// From its section.
    pub fn new(config: AveragingConfig) -> Self {
        Self {
            config,
            average: Average::default(),
        }
    }

    /// Steps that the mean is of so far.
    pub fn n_steps(&self) -> usize {
        self.average.n_steps
    }

    /// The step after which the mean is taken: everything that density control or a reset changed has settled.
    fn start<M: Method>(&self, run: &Run<M>) -> usize {
        let config = &run.config;
        let ends = Set::BOTH.map(|set| config.step_at(run.densify(set).during[1]));
        let settled = ends
            .into_iter()
            .fold(M::began(run, Set::Dynamic), usize::max);
        let begin = config.iterations - config.step_at(self.config.share);
        begin.max(settled.min(config.iterations))
    }
}

impl<M: Method> Extension<M> for Averaging {
    fn name(&self) -> &'static str {
        "averaging"
    }

    fn before_step(&mut self, run: &mut Run<M>) -> Result<(), Error> {
        run.frozen_after = Some(self.start(run));
        Ok(())
    }

    fn after_step(&mut self, run: &mut Run<M>) -> Result<(), Error> {
        let left = run.config.iterations.saturating_sub(run.step);
        if run.is_frozen() && left.is_multiple_of(INTERVAL) {
            self.average.add(&run.scene);
        }
        if left == 0 {
            let average = std::mem::take(&mut self.average);
            run.scene = average.of(run.scene.clone());
        }
        Ok(())
    }

    /// The rows that the mean is of are not those of the scene any more.
    fn skipped(&mut self, _run: &mut Run<M>) {
        self.average = Average::default();
    }

    fn save(&self) -> Saved {
        Saved {
            tensors: self.average.to_tensors(),
            ..Saved::of_values(&self.average.n_steps)
        }
    }

    fn restore(&mut self, run: &Run<M>, saved: Saved) -> Result<(), String> {
        let n_steps: usize = saved.read()?;
        if n_steps > 0 {
            let device = run.device.clone().inner();
            self.average = Average::from_tensors(n_steps, saved.tensors, &run.scene, &device)?;
        }
        Ok(())
    }
}

struct Adder<'a> {
    path: Path,
    average: &'a mut Average,
}

impl ModuleVisitor for Adder<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let values = param.val().inner();
        if values.dims().contains(&0) {
            return;
        }
        let values = values.flatten(0, D - 1);
        let name = self.path.name();
        let mean = match self.average.means.remove(&name) {
            None => values,
            Some(mean) => {
                let share = 1.0 / self.average.n_steps as f64;
                mean.clone() + (values - mean) * share
            }
        };
        self.average.means.insert(name, mean);
    }
}

struct Replacer {
    path: Path,
    means: BTreeMap<String, Tensor<1>>,
}

impl ModuleMapper for Replacer {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(mean) = self.means.remove(&self.path.name()) else {
            return param;
        };
        let (id, tensor, mapper) = param.consume();
        let mean = Tensor::from_inner(mean.reshape(tensor.dims())).require_grad();
        Param::from_mapped_value(id, mean, mapper)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::synth;
    use crate::train::config::tests::small;
    use crate::train::extensions::Demotion;
    use crate::train::{Trainer, latest_checkpoint, load_checkpoint, save_checkpoint};

    /// Of `bounce`, 4 cameras, 4 frames, 32x24 pixels, with both sets from step 18 on.
    fn trainer(share: f32) -> Trainer {
        let share = format!("extensions.averaging.share={share}");
        let config = small(&["iterations=60", &share]);
        let dataset = Arc::new(synth::loaded(4, 4, [32, 24]));
        Trainer::new(config, dataset, &Device::flex()).expect("valid")
    }

    fn start_of(trainer: &Trainer) -> usize {
        let averaging = trainer.hooks.get::<Averaging>().expect("on");
        averaging.start(&trainer.run)
    }

    /// The parameters after each step from `from` to the last.
    fn parameters(trainer: &mut Trainer, from: usize) -> Vec<BTreeMap<String, HostTensor>> {
        let mut found = Vec::new();
        while !trainer.is_finished() {
            trainer.step().expect("finite");
            if trainer.run.step >= from {
                found.push(named_parameters(trainer.scene()));
            }
        }
        found
    }

    #[test]
    fn the_scene_is_the_mean_of_the_steps_that_count() {
        let steps = parameters(&mut trainer(0.0), 31);
        let mut averaged = trainer(0.2);
        assert_eq!(start_of(&averaged), 48);
        let found = parameters(&mut averaged, 59);
        // Until then it is as without.
        assert!(found[0] == steps[28]);
        assert!(averaged.scene().dynamic.is_some());
        for (name, found) in &found[1] {
            // After 50 and 60 steps.
            let [a, b] = [19, 29].map(|step| &steps[step][name].values);
            let differ = a.iter().zip(b).filter(|(a, b)| a != b).count();
            assert!(differ > a.len() / 10, "`{name}` hardly changes");
            for ((a, b), found) in a.iter().zip(b).zip(&found.values) {
                let mean = 0.5 * (f64::from(*a) + f64::from(*b));
                let far = (f64::from(*found) - mean).abs();
                assert!(far <= 1e-6 * (1.0 + mean.abs()), "`{name}`: {found} {mean}");
            }
        }
    }

    #[test]
    fn it_is_taken_once_all_that_comes_and_goes_is_settled() {
        for (share, set, expected) in [
            (0.1, "", 54),
            (0.0, "", 60),
            (1.0, "", 42),
            (1.0, "densify.static.during=[0, 0.9]", 54),
            (1.0, "densify.dynamic.during=[0, 1]", 60),
            (1.0, "method.stages=[0.1, 0.8]", 48),
        ] {
            let share = format!("extensions.averaging.share={share}");
            let mut config = small(&["iterations=60", &share]);
            if !set.is_empty() {
                config.set(set).expect("a known key");
            }
            let dataset = Arc::new(synth::loaded(4, 4, [32, 24]));
            let trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
            assert_eq!(start_of(&trainer), expected, "{share} {set}");
        }
        // So few steps follow motion only where nothing holds Gaussians back.
        let free = [
            "extensions.averaging.share=0.1",
            "extensions.gaps.steadiness=0",
        ];
        let config = small(&[&["iterations=60"], &free[..]].concat());
        let dataset = Arc::new(synth::loaded(4, 4, [32, 24]));
        let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
        let demotion = |trainer: &mut Trainer, min_motion: f32| {
            let demotion = trainer.hooks.get_mut::<Demotion>().expect("on");
            demotion.config.interval = 1;
            demotion.min_motion = min_motion;
        };
        demotion(&mut trainer, 0.0);
        while trainer.run.step < 54 {
            trainer.step().expect("finite");
        }
        // All of them would be found at rest.
        demotion(&mut trainer, 10.0);
        let counts = trainer.scene().counts();
        assert!(counts.1 > 0);
        while !trainer.is_finished() {
            trainer.step().expect("finite");
            assert_eq!(
                trainer.scene().counts(),
                counts,
                "step {}",
                trainer.run.step
            );
        }
    }

    #[test]
    fn a_checkpoint_holds_it() {
        let mut whole = trainer(0.5);
        let mut cut = trainer(0.5);
        while cut.run.step < 57 {
            cut.step().expect("finite");
        }
        let folder = tempfile::tempdir().expect("a folder");
        save_checkpoint(&cut, folder.path(), 1.0).expect("written");
        let path = latest_checkpoint(folder.path()).expect("read");
        let path = path.expect("just written");
        let load = || load_checkpoint(&path, cut.run.dataset.clone(), &Device::flex());
        let (mut resumed, _) = load().expect("read");
        let averaging = resumed.hooks.get::<Averaging>().expect("on");
        assert_eq!(averaging.average.n_steps, 1);
        let last = |trainer: &mut Trainer| parameters(trainer, 60).pop();
        assert!(last(&mut whole) == last(&mut resumed));

        let averaging = cut.hooks.get::<Averaging>().expect("on");
        let means = averaging.average.to_tensors();
        let refused = |means: &BTreeMap<String, HostTensor>| {
            let file = path.join("averaging.safetensors");
            dash_model::scene_file::write_tensors(&file, means).expect("written");
            load().err().expect("refused").to_string()
        };
        let mut fewer = means.clone();
        let (name, mean) = fewer.pop_first().expect("means");
        let error = refused(&fewer);
        assert!(
            error.contains(&format!("means of `{name}`"))
                && error.contains("averaging.safetensors"),
            "{error}"
        );
        let mut more = means;
        more.insert(format!("{name}s"), mean);
        let error = refused(&more);
        assert!(error.contains("does not have"), "{error}");
    }
}
