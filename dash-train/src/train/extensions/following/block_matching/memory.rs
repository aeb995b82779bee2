//! Where block matching found fast groups, and what it costs the coarse field to forget it.
//!
//! One network holds the motion of all times. While it learns a new frame, which is half of what it sees then, what
//! it had learned of others drifts; and an object that moves by its own width in a frame does not find back.

use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use dash_model::{MotionField, TrajectoryBasis};

use crate::Error;

/// Numbers of a place.
pub(in super::super) const NUMBERS: usize = 8;
/// Members of a group that stand for it, at most.
pub(super) const MEMBERS: usize = 16;
/// Places that are asked in a step, at most.
const ASKED: usize = 512;
/// Keeps the slope of a square root finite at 0.
const TINY: f32 = 1e-12;

/// A Gaussian's place at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Where it is at rest.
    pub(super) point: [f32; 3],
    pub(super) displacement: [f32; 3],
    pub(super) time: f32,
    /// How far from there it may be at no cost.
    pub(super) tolerance: f32,
}

/// All places that were found.
#[derive(Debug, Clone, Default, PartialEq)]
pub(in super::super) struct Memory(Vec<Place>);

impl Memory {
    pub(super) fn add(&mut self, places: impl IntoIterator<Item = Place>) {
        let counts = |place: &Place| {
            let numbers = [place.point, place.displacement, [place.time; 3]].concat();
            let tolerance = place.tolerance;
            tolerance > 0.0 && tolerance.is_finite() && numbers.iter().all(|v| v.is_finite())
        };
        self.0.extend(places.into_iter().filter(counts));
    }

    pub(in super::super) fn clear(&mut self) {
        self.0.clear();
    }

    /// All numbers, [`NUMBERS`] a place.
    pub(in super::super) fn to_numbers(&self) -> Vec<f32> {
        let numbers = |place: &Place| {
            let [x, y, z] = place.point;
            let [dx, dy, dz] = place.displacement;
            [x, y, z, dx, dy, dz, place.time, place.tolerance]
        };
        self.0.iter().flat_map(numbers).collect()
    }

    /// The same again.
    pub(in super::super) fn from_numbers(numbers: &[f32]) -> Self {
        let place = |n: &[f32]| Place {
            point: [n[0], n[1], n[2]],
            displacement: [n[3], n[4], n[5]],
            time: n[6],
            tolerance: n[7],
        };
        Self(numbers.chunks_exact(NUMBERS).map(place).collect())
    }

    /// What the field pays for displacing to elsewhere: how far each place is off, in units of what is tolerated and
    /// from there on; a whole group counts as one place. The slope is the same however far it is, so that what is
    /// lost does not drown what the pictures say of the rest. Of all places or, of many, of a part that is
    /// another at each `step`. `None` of an empty memory.
    ///
    /// # Errors
    /// When the field does.
    pub(in super::super) fn cost(
        &self,
        field: &MotionField,
        basis: TrajectoryBasis,
        step: usize,
        device: &Device,
    ) -> Result<Option<Tensor<1>>, Error> {
        let stride = self.0.len().div_ceil(ASKED).max(1);
        let asked: Vec<Place> = self
            .0
            .iter()
            .skip(step % stride)
            .step_by(stride)
            .copied()
            .collect();
        let (n, spans) = (asked.len(), basis.len());
        if n == 0 {
            return Ok(None);
        }
        let tensor = |values: Vec<f32>, width: usize| {
            Tensor::<2>::from_data(TensorData::new(values, [n, width]), device)
        };
        let points = asked.iter().flat_map(|place| place.point).collect();
        let coefficients = field.coefficients(tensor(points, 3))?;
        let weights = asked
            .iter()
            .flat_map(|place| basis.at(place.time))
            .collect();
        let weights = tensor(weights, spans).reshape([n, spans, 1]);
        let places = (coefficients.reshape([n, spans, 3]) * weights).sum_dim(1);
        let found = asked.iter().flat_map(|place| place.displacement).collect();
        let units = asked.iter().map(|place| 1.0 / place.tolerance).collect();
        let off = (places.reshape([n, 3]) - tensor(found, 3)) * tensor(units, 1);
        let off = (off.powi_scalar(2).sum_dim(1) + TINY).sqrt();
        let excess = relu(off - 1.0).sum();
        Ok(Some(excess * (stride as f32 / MEMBERS as f32)))
    }
}

#[cfg(test)]
mod tests {
    use dash_model::SpaceBox;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;
    use crate::train::core::to_host;
    use crate::train::{Preset, TrainConfig};

    /// At a place that is `off` from rest, of which 0.1 is tolerated.
    fn place(off: f32) -> Place {
        Place {
            point: [0.2, -0.1, 0.3],
            displacement: [0.0, -0.6 * off, 0.8 * off],
            time: 0.75,
            tolerance: 0.1,
        }
    }

    fn memory(places: impl IntoIterator<Item = Place>) -> Memory {
        let mut memory = Memory::default();
        memory.add(places);
        memory
    }

    /// The cost to a field in which nothing moves.
    fn cost_at_rest(memory: &Memory, step: usize) -> Option<f32> {
        let device = Device::flex().autodiff();
        let config = TrainConfig::preset(Preset::Quick).method;
        let (basis, mut rng) = (TrajectoryBasis::polyline(4), Pcg64::seed_from_u64(1));
        let space = SpaceBox::fixed(2.0);
        let (grid, hidden) = (&config.motion_encoder(), config.motion_field.hidden);
        let field = MotionField::new(grid, hidden, basis, space, &mut rng, &device);
        let cost = memory.cost(&field.expect("valid"), basis, step, &device);
        cost.expect("valid").map(|cost| to_host(cost)[0])
    }

    #[test]
    fn what_is_off_by_more_than_is_tolerated_costs() {
        assert_eq!(cost_at_rest(&Memory::default(), 0), None);
        assert_eq!(cost_at_rest(&memory([place(0.099)]), 0), Some(0.0));
        let cost = cost_at_rest(&memory([place(0.099), place(0.3)]), 0);
        let expected = (0.3 / 0.1 - 1.0) / MEMBERS as f32;
        assert!((cost.expect("some") - expected).abs() < 1e-5, "{cost:?}");
    }

    #[test]
    fn of_many_places_each_step_asks_others_for_all() {
        let many = memory((0..3 * ASKED).map(|k| place(0.2 + 0.1 * (k % 3) as f32)));
        for step in 0..6 {
            let cost = cost_at_rest(&many, step).expect("some");
            let expected = (3 * ASKED * (1 + step % 3)) as f32 / MEMBERS as f32;
            assert!((cost / expected - 1.0).abs() < 1e-4, "{cost} {expected}");
        }
    }

    #[test]
    fn what_is_not_finite_is_not_remembered() {
        let mut bad = [place(0.2); 5];
        bad[0].point[1] = f32::NAN;
        bad[1].displacement[2] = f32::INFINITY;
        bad[2].tolerance = 0.0;
        bad[3].tolerance = f32::INFINITY;
        assert_eq!(memory(bad), memory([place(0.2)]));
    }

    #[test]
    fn numbers_tell_all() {
        let some = memory([place(0.2), place(0.4)]);
        let numbers = some.to_numbers();
        assert_eq!(numbers.len(), 2 * NUMBERS);
        assert_eq!(Memory::from_numbers(&numbers), some);
    }
}
