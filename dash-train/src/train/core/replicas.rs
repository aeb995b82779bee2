//! Replicas of a run, which share out the views of each step.
//!
//! Every replica has the whole scene. It draws its own views of a step, tells the others what they give, and takes the step that all
//! take. What views give is summed in their order, whoever has drawn them, so replicas end with the bits of one process
//! with as many views a step ([`TrainConfig::batch`](crate::train::TrainConfig::batch)).

mod threads;

use burn::tensor::{Tensor, TensorData};
use serde::{Deserialize, Serialize};

pub use threads::Threads;

use super::gradient_visit::InOrder;
use super::method::Method;
use super::optimizer::to_host;
use super::run::Run;
use super::view_pass::{Statistics, ViewPass};
use super::view_sums::ViewSums;
use crate::Error;
use crate::dataset::View;

/// How the replicas of a run hear of each other.
pub trait Exchange: Send {
    /// The number of this replica, from 0.
    fn rank(&self) -> usize;

    /// How many there are.
    fn replicas(&self) -> usize;

    /// Gives the others what this replica's views gave, and returns what the views of each replica gave, by rank, its own
    /// among them.
    ///
    /// # Errors
    /// When a replica has stopped.
    fn all(&mut self, own: Vec<ViewMessage>) -> Result<Vec<Vec<ViewMessage>>, Error>;
}

/// What a view gave, for other replicas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewMessage {
    /// Steps done before.
    pub step: usize,
    /// The view's name.
    pub view: String,
    /// Its loss and mean squared error.
    pub losses: [f32; 2],
    /// The gradient of every parameter, in order; `None` of one without.
    pub gradients: Vec<Option<Vec<f32>>>,
    /// Of the static and of the dynamic Gaussians: lengths of gradients on the screen, and 1 for each that is shown.
    pub sums: [[Vec<f32>; 2]; 2],
    /// What the method sums over views, two numbers for each static Gaussian.
    pub of_method: Option<Vec<f32>>,
}

impl ViewMessage {
    /// Whether it has the sizes of another one.
    fn has_sizes_of(&self, other: &Self) -> bool {
        let sizes = |message: &Self| message.sums.each_ref().map(|[lengths, _]| lengths.len());
        let mut pairs = self.gradients.iter().zip(&other.gradients);
        self.gradients.len() == other.gradients.len()
            && sizes(self) == sizes(other)
            && pairs.all(|pair| match pair {
                (Some(a), Some(b)) => a.len() == b.len(),
                _ => true,
            })
    }
}

/// Whether a replica draws the view at a place among a step's.
pub(super) fn draws(exchange: Option<&dyn Exchange>, place: usize) -> bool {
    exchange.is_none_or(|exchange| place % exchange.replicas() == exchange.rank())
}

/// What all of a step's views gave, given what this replica's did.
///
/// # Errors
/// When a replica has stopped, or is of another run.
pub(super) fn all_passes<M: Method>(
    run: &Run<M>,
    exchange: &mut dyn Exchange,
    views: &[&View],
    own: Vec<ViewPass>,
) -> Result<Vec<ViewPass>, Error> {
    let n = exchange.replicas();
    let places = (exchange.rank()..views.len()).step_by(n);
    let messages = own.into_iter().zip(places);
    let messages = messages.map(|(pass, place)| told(run, views[place], views.len(), pass));
    let messages = messages.collect::<Result<Vec<_>, _>>()?;
    let own = messages.first().cloned();
    let mut of_ranks: Vec<_> = exchange
        .all(messages)?
        .into_iter()
        .map(Vec::into_iter)
        .collect();
    let heard = (0..views.len()).map(|place| {
        let next = of_ranks.get_mut(place % n).and_then(Iterator::next);
        let fits = |message: &ViewMessage| {
            message.step == run.step
                && message.view == views[place].name
                && own.as_ref().is_none_or(|own| message.has_sizes_of(own))
        };
        next.filter(fits)
            .map(|message| heard(run, message))
            .ok_or_else(|| {
                let remedy = "give all the same configuration, dataset and checkpoint";
                Error::Replicas(format!(
                    "view {place} of the step is of another run; {remedy}"
                ))
            })
    });
    heard.collect()
}

fn told<M: Method>(
    run: &Run<M>,
    view: &View,
    views: usize,
    pass: ViewPass,
) -> Result<ViewMessage, Error> {
    let mut sums = run.no_sums();
    pass.statistics.add_to(sums.each_mut(), view, views)?;
    let gradients = pass.gradients.into_iter();
    Ok(ViewMessage {
        step: run.step,
        view: view.name.clone(),
        losses: pass.losses.map(|loss| to_host(loss)[0]),
        gradients: gradients.map(|gradient| gradient.map(to_host)).collect(),
        sums: sums.map(|sums| <[_; 2]>::from(sums.totals())),
        of_method: pass.of_method.map(to_host),
    })
}

fn heard<M>(run: &Run<M>, message: ViewMessage) -> ViewPass {
    let device = run.device.clone().inner();
    let upload = |values: Vec<f32>| {
        let n = values.len();
        Tensor::<1>::from_data(TensorData::new(values, [n]), &device)
    };
    let gradients = message.gradients.into_iter();
    let gradients: InOrder = gradients.map(|gradient| gradient.map(upload)).collect();
    let of_method = message.of_method.map(|values| {
        let n = values.len() / 2;
        upload(values).reshape([n, 2])
    });
    let sums = message.sums;
    let sums = sums.map(|[sums, views]| ViewSums::from_totals(&sums, &views, &device));
    ViewPass {
        losses: message.losses.map(|loss| upload(vec![loss])),
        gradients,
        statistics: Statistics::Sums(Box::new(sums)),
        of_method,
    }
}

#[cfg(test)]
mod tests;
