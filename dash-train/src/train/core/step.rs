//! One step of training.

use burn::tensor::{Gradients, Tensor};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use super::densify::{self, DensityStatistics, Round, Rules};
use super::gradient_visit::{GradientVisit, InOrder, sum};
use super::guard::{self, Reading};
use super::hooks::Hooks;
use super::method::Method;
use super::module_visit::ModuleVisit;
use super::optimizer::Rate;
use super::pass::forward;
use super::replicas;
use super::run::Run;
use super::sets::Set;
use super::view_pass::ViewPass;
use crate::Error;
use crate::dataset::View;

/// What one step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Steps done so far.
    pub step: usize,
    /// The stage of the method that it belonged to.
    pub stage: &'static str,
    /// Mean loss of the steps that were read last: of this one on a CPU, of fifty on a GPU, which is read once in as many
    /// steps.
    pub loss: f32,
    /// Mean peak signal-to-noise ratio of their training views, dB.
    pub psnr: f32,
    /// How many steps were read in this one; 0: `loss` and `psnr` have not changed.
    pub n_read: usize,
    /// Static Gaussians.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
    /// Steps among those read that changed nothing because something was not finite. They don't count in `loss` and `psnr`,
    /// unless all were skipped: then these are of the last, and need not be finite.
    pub n_skipped: usize,
}

impl StepReport {
    /// Steps that `loss` and `psnr` are new means of; 0 where nothing sound was read.
    pub fn n_sound(&self) -> usize {
        self.n_read - self.n_skipped
    }
}

/// One optimisation step, with what its step number brings: changes of stage, density control.
///
/// A step in which the loss, a parameter or a gradient is not finite changes no parameter and no moment: what is at
/// fault is removed or cleared, and told by a warning and by [`Run::take_skipped_steps`].
///
/// # Errors
/// When too many steps in a row had to be skipped, or a kernel refuses its input.
pub fn step<M: Method>(run: &mut Run<M>, hooks: &mut Hooks<M>) -> Result<StepReport, Error> {
    if !std::mem::replace(&mut hooks.has_begun, true) {
        hooks.each(run, |extension, run| extension.begin(run))?;
    }
    M::before_step(run)?;
    hooks.each(run, |extension, run| extension.before_step(run))?;
    let config = &run.config;
    let sh_interval = config.step_at(config.sh_interval).max(1);
    run.scene.settings.sh_degree = (run.step / sh_interval).min(config.sh_degree);

    let dataset = run.dataset.clone();
    run.updates_scene = true;
    let indices: Vec<usize> = (0..run.config.batch)
        .map(|_| next_view(run, hooks))
        .collect();
    let views: Vec<&View> = indices.iter().map(|&index| &dataset.views[index]).collect();
    let (passes, mut gradients) = draw(run, hooks, &views)?;
    let [loss, mse] = [0, 1].map(|k| mean(passes.iter().map(|pass| pass.losses[k].clone())));
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    let reading = guard::look(run, &gradients, [loss, mse], &names.join(", "));
    let [n_read, n_skipped] = reading.as_ref().map_or([0; 2], Reading::counts);
    if let Some(reading) = &reading {
        run.last_means = reading.means();
    }
    match reading.filter(|reading| !reading.is_sound()) {
        None => {
            for (view, pass) in views.iter().zip(passes) {
                let statistics = pass.statistics;
                statistics.add_to(run.gathered(), view, views.len())?;
                M::after_backward(run, pass.of_method)?;
            }
            for extension in &mut hooks.extensions {
                extension.after_backward(run, &mut gradients);
            }
            update(run, &mut gradients);
            if n_read > 0 {
                run.skipped.end_row();
            }
        }
        Some(reading) => {
            guard::skip(run, reading)?;
            hooks.each(run, |extension, run| {
                extension.skipped(run);
                Ok(())
            })?;
        }
    }
    run.optimizer.stop = None;
    let stage = M::stage(run);
    run.step += 1;
    hooks.each(run, |extension, run| {
        extension.after_update(run);
        Ok(())
    })?;
    control_density(run, hooks);
    hooks.each(run, |extension, run| extension.after_step(run))?;

    let (n_static, n_dynamic) = run.scene.counts();
    let [loss, psnr] = run.last_means;
    Ok(StepReport {
        step: run.step,
        stage,
        loss,
        psnr,
        n_read,
        n_static,
        n_dynamic,
        n_skipped,
    })
}

/// The mean over a step's views; of a single one itself.
fn mean(values: impl ExactSizeIterator<Item = Tensor<1>>) -> Tensor<1> {
    let n = values.len() as f32;
    let sum = values.reduce(|sum, value| sum + value);
    let sum = sum.expect("a step has a view");
    if n > 1.0 { sum / n } else { sum }
}

/// The index of the next view to train on.
fn next_view<M: Method>(run: &mut Run<M>, hooks: &mut Hooks<M>) -> usize {
    let mut extensions = hooks.extensions.iter_mut();
    let chosen = extensions.find_map(|extension| extension.next_view(run));
    let n = run.train_views.len();
    let place = chosen.unwrap_or_else(|| run.sampler.next(n, |_| true, &mut run.rng));
    let view = run.train_views[place];
    announce_views(run, view);
    view
}

/// Draws the step's views, a replica those that are its own: what each gives, and the gradients of the step's loss, the mean
/// of theirs.
///
/// Each view has a backward pass of its own, so one graph is held at a time. Where there are several, each has a random
/// generator of its own, so that no replica need know what others draw.
fn draw<M: Method>(
    run: &mut Run<M>,
    hooks: &mut Hooks<M>,
    views: &[&View],
) -> Result<(Vec<ViewPass>, Gradients), Error> {
    let several = views.len() > 1;
    let key: u64 = if several { run.rng.random() } else { 0 };
    let of_run = run.rng.clone();
    let (mut passes, mut gradients) = (Vec::new(), Vec::new());
    for (place, &view) in views.iter().enumerate() {
        if several {
            run.rng = Pcg64::seed_from_u64(key.wrapping_add(place as u64));
        }
        for extension in &mut hooks.extensions {
            extension.before_forward(run, view)?;
        }
        if !replicas::draws(hooks.exchange.as_deref(), place) {
            continue;
        }
        let waited = waiting(run);
        let forward = forward(run, hooks, view)?;
        run.waited_secs += waiting(run) - waited;
        let mut of_view = match views.len() {
            1 => forward.loss.backward(),
            n => (forward.loss.clone() / n as f32).backward(),
        };
        passes.push(ViewPass::new(run, view, forward, &mut of_view));
        gradients.push(of_view);
    }
    if passes.is_empty() {
        let told = format!("none of the step's {} views is this replica's", views.len());
        return Err(Error::Replicas(told));
    }
    if several {
        run.rng = of_run;
        for (pass, gradients) in passes.iter_mut().zip(&mut gradients) {
            let visit = GradientVisit::take(gradients, &mut pass.gradients);
            visit_gradients(run, hooks, visit);
        }
        if let Some(exchange) = hooks.exchange.as_deref_mut() {
            passes = replicas::all_passes(run, exchange, views, passes)?;
        }
        let of_views = passes
            .iter_mut()
            .map(|pass| std::mem::take(&mut pass.gradients));
        let sums: InOrder = sum(of_views);
        visit_gradients(run, hooks, GradientVisit::put(&mut gradients[0], sums));
    }
    Ok((passes, gradients.swap_remove(0)))
}

/// Shows everything that learns.
fn visit_gradients<M: Method>(run: &mut Run<M>, hooks: &Hooks<M>, mut visit: GradientVisit<'_>) {
    visit.module(&run.scene);
    let mut visit = ModuleVisit::Gradients(visit);
    run.method.visit(&mut visit);
    if let ModuleVisit::Gradients(visit) = &mut visit {
        for extension in &hooks.extensions {
            extension.gradients(visit);
        }
    }
}

/// Tells the dataset which views come next, where the order is a new one.
fn announce_views<M>(run: &mut Run<M>, view: usize) {
    if let Some(upcoming) = run.sampler.tell_new_round() {
        let upcoming = upcoming.map(|place| run.train_views[place]);
        let views = std::iter::once(view).chain(upcoming);
        let views = views.map(|index| &run.dataset.views[index]);
        run.dataset.announce(views);
    }
}

/// Seconds that anyone has waited for images.
fn waiting<M>(run: &Run<M>) -> f64 {
    let statistics = run.dataset.frame_statistics();
    statistics.map_or(0.0, |statistics| statistics.waited_secs)
}

/// One step of Adam on everything that has a gradient.
fn update<M: Method>(run: &mut Run<M>, gradients: &mut Gradients) {
    if run.updates_scene {
        let progress = run.step as f32 / run.config.iterations as f32;
        let rates = run.rates.at(progress, run.extent);
        // Taken, not cloned: what nobody else holds is changed in place.
        let mut optimizer = std::mem::take(&mut run.optimizer);
        let views = run.config.batch;
        let rate =
            |name: &str| Rate::plain(rates(name) * M::rate_factor(run, name)).of_views(views);
        let static_set = run.scene.static_set.clone();
        let static_set = optimizer.take("scene.static_set", static_set, gradients, rate);
        run.scene.static_set = static_set;
        let mut dynamic = run.scene.dynamic.take();
        if let Some(own) = dynamic.take() {
            let rate =
                |name: &str| Rate::plain(rates(name) * M::rate_factor(run, name)).of_views(views);
            dynamic = Some(optimizer.take("scene.dynamic", own, gradients, rate));
        }
        optimizer.step_taken();
        run.scene.static_set = optimizer.give_back(run.scene.static_set.clone());
        run.scene.dynamic = dynamic.map(|dynamic| optimizer.give_back(dynamic));
        run.optimizer = optimizer;
    }
    M::update(run, gradients);
}

/// Rounds of density control and opacity resets that are due at the run's step.
fn control_density<M: Method>(run: &mut Run<M>, hooks: &mut Hooks<M>) {
    for set in Set::BOTH {
        let config = run.densify(set).clone();
        if !densify::round_due(&run.config, &config, run.step) {
            continue;
        }
        let Some(gaussians) = run.gaussians(set) else {
            continue;
        };
        let rows = gaussians.to_rows();
        let (max_gaussians, scale) = (M::capacity(run, set), run.scale());
        let (step, since) = (run.step, M::began(run, set));
        let statistics = DensityStatistics::of(&run.state(set).gathered);
        let mut rules = Rules {
            gradient_threshold: run.config.densify.gradient_threshold,
            prunes_oversized: true,
        };
        for extension in &hooks.extensions {
            extension.density_rules(set, rows.len(), &mut rules);
        }
        let round = Round {
            set,
            step,
            rows: &rows,
            statistics: &statistics,
            rules,
            max_gaussians,
            was_reset: densify::was_reset(&run.config, &config, since, step),
            scale,
            config: &config,
        };
        let edit = hooks.densify.round(&round, &mut run.rng);
        run.apply(set, &edit);
    }
    for set in Set::BOTH {
        let config = run.densify(set);
        let due = densify::reset_due(&run.config, config, M::began(run, set), run.step);
        if due && M::may_reset(run, set) {
            let Some(gaussians) = run.gaussians(set).cloned() else {
                continue;
            };
            run.set_gaussians(set, densify::with_low_opacity(gaussians));
            let name = format!("{}opacity_logits", set.prefix());
            run.optimizer.reset(&name);
        }
    }
    hooks.tell_edits(run);
}

#[cfg(test)]
mod tests;
