//! Times of repeated runs.

use std::time::{Duration, Instant};

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::numbers::quantile;

/// How the times are taken, for the file.
pub(super) const RULE: &str = "median and quartiles of up to 15 runs after at least two, and 0.1 s of them, that do not count, the device synchronised before the \
     clock stops; fewer runs, at least one, where they take longer than 2 s together";
const WARM_UPS: usize = 2;
/// Clocks that fell while a device idled have risen by then.
const WARM: Duration = Duration::from_millis(100);
const RUNS: usize = 15;
/// No run begins after this.
const ENOUGH: Duration = Duration::from_secs(2);

/// Milliseconds of repeated runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timing {
    /// The median.
    pub median_ms: f64,
    /// The first quartile.
    pub first_quartile_ms: f64,
    /// The third quartile.
    pub third_quartile_ms: f64,
    /// Runs that count.
    pub n_runs: usize,
}

/// Times `work` on a device; on the host without one.
///
/// # Errors
/// What `work` refuses, and when the device breaks down.
pub(super) fn time(
    device: Option<&Device>,
    mut work: impl FnMut() -> Result<(), Error>,
) -> Result<Timing, Error> {
    let mut once = || {
        let start = Instant::now();
        work()?;
        if let Some(device) = device {
            device
                .sync()
                .map_err(|e| Error::DeviceFault(e.to_string()))?;
        }
        Ok::<f64, Error>(start.elapsed().as_secs_f64() * 1e3)
    };
    let start = Instant::now();
    let mut n_warm_ups = 0;
    while (n_warm_ups < WARM_UPS || start.elapsed() < WARM) && start.elapsed() < ENOUGH {
        once()?;
        n_warm_ups += 1;
    }
    let start = Instant::now();
    let mut runs = vec![once()?];
    while runs.len() < RUNS && start.elapsed() < ENOUGH {
        runs.push(once()?);
    }
    Ok(quartiles(runs))
}

fn quartiles(runs: Vec<f64>) -> Timing {
    let at = |share: f64| quantile(runs.iter().copied(), share);
    Timing {
        median_ms: at(0.5),
        first_quartile_ms: at(0.25),
        third_quartile_ms: at(0.75),
        n_runs: runs.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_the_runs() {
        let timing = quartiles(vec![4.0, 1.0, 3.0, 2.0, 5.0]);
        assert_eq!(
            (
                timing.first_quartile_ms,
                timing.median_ms,
                timing.third_quartile_ms
            ),
            (2.0, 3.0, 4.0)
        );
        assert_eq!(quartiles(vec![2.0, 1.0]).median_ms, 1.5);
        assert_eq!(quartiles(vec![7.0]).third_quartile_ms, 7.0);
    }

    #[test]
    fn a_refusal_ends_it() {
        let refused = time(None, || Err(Error::Config("no".into())));
        assert!(refused.is_err());
        let timing = time(None, || Ok(())).expect("nothing to refuse");
        assert_eq!(timing.n_runs, RUNS);
    }
}
