//! Order statistics and random numbers, written once for the whole crate.

use num_traits::float::TotalOrder;
use num_traits::{Float, FloatConst};
use rand::Rng;
use rand::distr::{Distribution, StandardUniform};

/// The middle value, the upper one of the two middle values of an even number; `None` without values.
///
/// NaN counts as larger than every number.
pub(crate) fn median<T: TotalOrder + Copy>(values: impl IntoIterator<Item = T>) -> Option<T> {
    let mut values: Vec<T> = values.into_iter().collect();
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    Some(*values.select_nth_unstable_by(middle, T::total_cmp).1)
}

/// Median, lowest and highest of the finite values; `None` without any.
///
/// Of an even number of values the median is the mean of the middle two.
pub(crate) fn median_and_range(values: impl IntoIterator<Item = f64>) -> Option<[f64; 3]> {
    let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (*sorted.first()?, *sorted.last()?);
    let n = sorted.len();
    Some([(sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0, low, high])
}

/// The value that `share` of the values, which must be some, don't exceed; between two values by linear
/// interpolation.
pub(crate) fn quantile(values: impl IntoIterator<Item = f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let place = share * (sorted.len() - 1) as f64;
    let [below, above] = [place.floor(), place.ceil()].map(|place| sorted[place as usize]);
    below + (above - below) * place.fract()
}

/// A standard normal number (Box-Muller).
///
/// Trained scenes and synthetic datasets depend on every bit of it.
pub(crate) fn standard_normal<T: Float + FloatConst>(rng: &mut impl Rng) -> T
where
    StandardUniform: Distribution<T>,
{
    let minus_two = -(T::one() + T::one());
    // 1 - [0, 1) keeps the logarithm finite.
    let radius = (minus_two * (T::one() - rng.random::<T>()).ln()).sqrt();
    radius * (T::TAU() * rng.random::<T>()).cos()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn the_median_is_a_middle_value_and_nan_is_large() {
        assert_eq!(median([3.0_f32, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 3.0]), Some(3.0));
        assert_eq!(median([f64::NAN, 1.0, 2.0]), Some(2.0));
        assert_eq!(median::<f64>([]), None);
    }

    #[test]
    fn the_median_with_its_range_leaves_out_what_is_not_finite() {
        assert_eq!(median_and_range([3.0, 1.0, 2.0]), Some([2.0, 1.0, 3.0]));
        assert_eq!(median_and_range([4.0, 1.0]), Some([2.5, 1.0, 4.0]));
        assert_eq!(median_and_range([f64::NAN, 7.0]), Some([7.0, 7.0, 7.0]));
        assert_eq!(median_and_range([f64::NAN]), None);
        assert_eq!(median_and_range([]), None);
    }

    #[test]
    fn quantiles_lie_between_values() {
        assert_eq!(quantile([4.0, 0.0, 2.0], 0.25), 1.0);
        assert_eq!(quantile([4.0, 0.0, 2.0], 1.0), 4.0);
        assert_eq!(quantile([7.0], 0.9), 7.0);
    }

    #[test]
    fn normal_numbers_keep_their_bits_and_their_moments() {
        let mut rng = Pcg64::seed_from_u64(9);
        let mut twin = rng.clone();
        for _ in 0..1000 {
            let radius = (-2.0 * (1.0 - twin.random::<f32>()).ln()).sqrt();
            let expected = radius * (std::f32::consts::TAU * twin.random::<f32>()).cos();
            assert_eq!(
                standard_normal::<f32>(&mut rng).to_bits(),
                expected.to_bits()
            );
        }
        let values: Vec<f64> = (0..20_000).map(|_| standard_normal(&mut rng)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
        assert!(
            mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05,
            "{mean}, {variance}"
        );
    }
}
