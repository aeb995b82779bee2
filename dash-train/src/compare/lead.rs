//! How far one method is ahead of another, and whether its seeds tell.

/// 0.975 quantiles of Student's t for 1, 2, .. degrees of freedom; for more, the last.
const T_QUANTILES: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160,
    2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056,
    2.052, 2.048, 2.045, 2.042,
];

/// The difference between the means of two methods over their seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lead {
    /// The first method's mean less the second's.
    pub mean: f64,
    /// Half the width of its 95 % confidence interval (Welch's t); absent where a method has one seed only.
    pub margin: Option<f64>,
}

/// What a lead says of the first method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// It is better, whatever the seeds.
    Ahead,
    /// Seeds differ by more than the methods.
    Level,
    /// It is worse, whatever the seeds.
    Behind,
    /// One seed tells nothing.
    Unknown,
}

impl Lead {
    /// Of scores, the higher the better, by seed; `None` where a method has none.
    pub fn of(first: &[f64], second: &[f64]) -> Option<Self> {
        let (first, second) = (Sample::of(first)?, Sample::of(second)?);
        let mean = first.mean - second.mean;
        let margin = match (first.squared_error, second.squared_error) {
            (Some(a), Some(b)) => {
                let freedom =
                    (a + b).powi(2) / (a * a / (first.n - 1.0) + b * b / (second.n - 1.0));
                // Without any spread there is no freedom to speak of, and no margin.
                let whole = if freedom.is_finite() { freedom } else { 1.0 };
                let place = (whole as usize).clamp(1, T_QUANTILES.len()) - 1;
                Some(T_QUANTILES[place] * (a + b).sqrt())
            }
            _ => None,
        };
        Some(Self { mean, margin })
    }

    /// What it says of the first method.
    pub fn standing(self) -> Standing {
        match self.margin {
            None => Standing::Unknown,
            Some(margin) if self.mean > margin => Standing::Ahead,
            Some(margin) if self.mean < -margin => Standing::Behind,
            Some(_) => Standing::Level,
        }
    }
}

impl Standing {
    /// As tables say it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Ahead => "ahead",
            Self::Level => "level",
            Self::Behind => "behind",
            Self::Unknown => "one seed",
        }
    }
}

/// The mean of finite values, and the square of its standard error where there are several.
struct Sample {
    n: f64,
    mean: f64,
    squared_error: Option<f64>,
}

impl Sample {
    fn of(values: &[f64]) -> Option<Self> {
        let finite = values.iter().filter(|value| value.is_finite());
        let n = finite.clone().count() as f64;
        if n == 0.0 {
            return None;
        }
        let mean = finite.clone().sum::<f64>() / n;
        let squares: f64 = finite.map(|value| (value - mean).powi(2)).sum();
        Some(Self {
            n,
            mean,
            squared_error: (n > 1.0).then(|| squares / (n - 1.0) / n),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lead_is_one_where_it_is_larger_than_its_margin() {
        // Two samples of three with a variance of 1: Welch has four degrees of freedom, and the standard error is sqrt(2/3).
        let margin = 2.776 * (2.0f64 / 3.0).sqrt();
        let lead = |by: f64| {
            let first = [1.0, 2.0, 3.0].map(|value| value + by);
            Lead::of(&first, &[1.0, 2.0, 3.0]).expect("scores")
        };
        let found = lead(5.0);
        assert!((found.mean - 5.0).abs() < 1e-12);
        assert!((found.margin.expect("seeds") - margin).abs() < 1e-9);
        assert_eq!(found.standing(), Standing::Ahead);
        assert_eq!(lead(2.0).standing(), Standing::Level);
        assert_eq!(lead(-2.0).standing(), Standing::Level);
        assert_eq!(lead(-2.5).standing(), Standing::Behind);
    }

    #[test]
    fn a_steady_method_against_an_unsteady_one_has_the_freedom_of_the_unsteady_one() {
        let lead = Lead::of(&[1.0, 1.0, 1.0], &[0.0, 1.0, 2.0]).expect("scores");
        // Two degrees of freedom; the standard error is sqrt(1/3).
        let margin = 4.303 / 3f64.sqrt();
        assert!((lead.margin.expect("seeds") - margin).abs() < 1e-9);
    }

    #[test]
    fn one_seed_tells_nothing() {
        let lead = Lead::of(&[9.0], &[1.0, 2.0]).expect("scores");
        assert_eq!((lead.mean, lead.margin), (7.5, None));
        assert_eq!(lead.standing(), Standing::Unknown);
        assert_eq!(Lead::of(&[], &[1.0]), None);
        assert_eq!(Lead::of(&[f64::NAN], &[1.0]), None);
    }

    #[test]
    fn equal_scores_are_level_and_others_without_spread_are_not() {
        let lead = |first: f64| Lead::of(&[first; 3], &[1.0; 3]).expect("scores").standing();
        assert_eq!(lead(1.0), Standing::Level);
        assert_eq!(lead(1.5), Standing::Ahead);
        assert_eq!(lead(0.5), Standing::Behind);
    }
}
