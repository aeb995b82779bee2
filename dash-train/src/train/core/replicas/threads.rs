//! Replicas in the threads of one process.

use std::sync::mpsc::{Receiver, Sender, channel};

use super::{Exchange, ViewMessage};
use crate::Error;

/// One of the replicas of a run in the threads of one process.
///
/// ```
/// use dash_train::train::core::{Exchange, Threads};
///
/// let replicas = Threads::replicas(2);
/// assert_eq!(replicas[1].rank(), 1);
/// ```
pub struct Threads {
    rank: usize,
    to: Vec<Sender<Vec<ViewMessage>>>,
    from: Vec<Receiver<Vec<ViewMessage>>>,
}

impl Threads {
    /// So many, one for each thread.
    pub fn replicas(n: usize) -> Vec<Self> {
        let mut replicas: Vec<Self> = (0..n)
            .map(|rank| Self {
                rank,
                to: Vec::new(),
                from: Vec::new(),
            })
            .collect();
        for from in 0..n {
            for to in 0..n {
                let (sender, receiver) = channel();
                replicas[from].to.push(sender);
                replicas[to].from.push(receiver);
            }
        }
        replicas
    }
}

impl Exchange for Threads {
    fn rank(&self) -> usize {
        self.rank
    }

    fn replicas(&self) -> usize {
        self.to.len()
    }

    fn all(&mut self, own: Vec<ViewMessage>) -> Result<Vec<Vec<ViewMessage>>, Error> {
        let stopped = || Error::Replicas("another replica has stopped".to_string());
        for sender in &self.to {
            sender.send(own.clone()).map_err(|_| stopped())?;
        }
        let all = self
            .from
            .iter()
            .map(|from| from.recv().map_err(|_| stopped()));
        all.collect()
    }
}
