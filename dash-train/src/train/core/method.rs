//! What a method is: how the scene changes over time, and how that is learned.

use burn::tensor::{Gradients, Tensor};

use super::forward::Forward;
use super::module_visit::ModuleVisit;
use super::run::Run;
use super::saved::Saved;
use super::sets::Set;
use crate::Error;
use crate::dataset::View;

/// Displaced means of the static set at a view's time.
pub struct Moved {
    /// Means `[N, 3]`, world units.
    pub means: Tensor<2>,
    /// How far each Gaussian moves over the clip `[N]`, world units.
    pub motion: Tensor<1>,
}

/// A method for scenes that change over time. The defaults are 3DGS: nothing moves.
pub trait Method: Sized + Send + 'static {
    /// Before the step's view is chosen: changes of stage.
    ///
    /// # Errors
    /// When a module refuses its configuration.
    fn before_step(_run: &mut Run<Self>) -> Result<(), Error> {
        Ok(())
    }

    /// What the stage of the step that is under way is called.
    fn stage(_run: &Run<Self>) -> &'static str {
        "3DGS"
    }

    /// Where the static Gaussians are in a view, if the method moves them.
    ///
    /// # Errors
    /// When a shape does not fit.
    fn moved(_run: &Run<Self>, _view: &View) -> Result<Option<Moved>, Error> {
        Ok(None)
    }

    /// Packed splats of the dynamic Gaussians in a view, and what the method adds to the loss on the way; `None`
    /// without any.
    ///
    /// # Errors
    /// When a shape does not fit.
    fn dynamic_splats(
        run: &mut Run<Self>,
        view: &View,
    ) -> Result<(Option<Tensor<2>>, Vec<Tensor<1>>), Error> {
        let splats = run.scene.dynamic_splats(&view.camera, view.time)?;
        Ok((splats, Vec::new()))
    }

    /// Terms of the loss.
    ///
    /// # Errors
    /// When a shape does not fit.
    fn loss_terms(
        _run: &mut Run<Self>,
        _view: &View,
        _forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        Ok(Vec::new())
    }

    /// What the method sums over views, two numbers for each static Gaussian `[N, 2]`, of a view's splats `[N, C]`.
    fn statistics(_run: &Run<Self>, _view: &View, _splats: &Tensor<2>) -> Option<Tensor<2>> {
        None
    }

    /// After a step's backward passes, if its gradients are finite, with the statistics of each of its views.
    ///
    /// # Errors
    /// When a shape does not fit.
    fn after_backward(_run: &mut Run<Self>, _statistics: Option<Tensor<2>>) -> Result<(), Error> {
        Ok(())
    }

    /// One step of the optimizer on modules of the method's own.
    fn update(_run: &mut Run<Self>, _gradients: &mut Gradients) {}

    /// Factor of the learning rate of a parameter of the scene, by its path.
    fn rate_factor(_run: &Run<Self>, _name: &str) -> f32 {
        1.0
    }

    /// Shows the method's own modules.
    fn visit(&mut self, _visit: &mut ModuleVisit<'_>) {}

    /// Lets state per Gaussian follow an edit of a set's rows. `sources` are rows before it.
    fn rows_changed(&mut self, _set: Set, _sources: &[usize]) {}

    /// Most Gaussians of a set now.
    fn capacity(run: &Run<Self>, set: Set) -> usize {
        run.densify(set).max_gaussians
    }

    /// The step from which on rounds of a set's density control count.
    fn began(_run: &Run<Self>, _set: Set) -> usize {
        0
    }

    /// Whether a set's opacities may be reset now.
    fn may_reset(_run: &Run<Self>, _set: Set) -> bool {
        true
    }

    /// The state for a checkpoint.
    fn save(&self) -> Saved {
        Saved::default()
    }

    /// Takes up the state of [`Method::save`]; the scene is restored already.
    ///
    /// # Errors
    /// What does not fit.
    fn restore(_run: &mut Run<Self>, _saved: Saved) -> Result<(), String> {
        Ok(())
    }
}

/// 3DGS: nothing moves.
#[derive(Debug, Clone, Copy, Default)]
pub struct Static;

impl Method for Static {}
