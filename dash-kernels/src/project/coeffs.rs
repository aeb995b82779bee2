//! Colour coefficients in two tensors: those of the constant function and the rest.

use burn::tensor::Tensor;

use crate::KernelError;

use super::{check_shape, sh};

/// Colour coefficients in two tensors, like `f_dc` and `f_rest` of 3DGS files. [`project`](super::project) reads both
/// without joining them.
#[derive(Debug, Clone)]
pub struct ShCoeffs {
    /// Of the constant function `[N, 1, 3]`.
    pub dc: Tensor<3>,
    /// Of the others `[N, K - 1, 3]`.
    pub rest: Tensor<3>,
}

impl ShCoeffs {
    /// All coefficients `[N, K, 3]`.
    pub fn joined(self) -> Tensor<3> {
        if self.rest.dims()[1] == 0 {
            return self.dc;
        }
        Tensor::cat(vec![self.dc, self.rest], 1)
    }

    /// K.
    ///
    /// # Errors
    /// [`KernelError::Shape`] and [`KernelError::Config`] when they are not those of `n` Gaussians, up to a degree.
    pub(super) fn check(&self, n: usize) -> Result<usize, KernelError> {
        let k = 1 + self.rest.dims()[1];
        check_shape("sh_coeffs.dc", &self.dc.dims(), &[n, 1, 3])?;
        check_shape("sh_coeffs.rest", &self.rest.dims(), &[n, k - 1, 3])?;
        Ok(k)
    }
}

/// From all coefficients `[N, K, 3]`; copies them.
impl From<Tensor<3>> for ShCoeffs {
    fn from(all: Tensor<3>) -> Self {
        let [n, k, channels] = all.dims();
        if k <= 1 {
            let rest = Tensor::zeros([n, 0, channels], &all.device());
            return Self { dc: all, rest };
        }
        Self {
            dc: all.clone().narrow(1, 0, 1),
            rest: all.narrow(1, 1, k - 1),
        }
    }
}

/// Colour coefficients in row-major slices, one or two.
#[derive(Debug, Clone, Copy)]
pub struct ShSlices<'a, T> {
    /// Starts at the first Gaussian's coefficients of the constant function.
    dc: &'a [T],
    /// Starts at the first Gaussian's remaining coefficients.
    rest: &'a [T],
    /// From one Gaussian to the next.
    strides: [usize; 2],
    n_coeffs: usize,
}

impl<'a, T> ShSlices<'a, T> {
    /// All in one slice `[N, K, 3]`, where `n_coeffs` is K.
    pub fn joined(all: &'a [T], n_coeffs: usize) -> Self {
        Self {
            dc: all,
            rest: all.get(3..).unwrap_or_default(),
            strides: [3 * n_coeffs; 2],
            n_coeffs,
        }
    }

    /// The constant ones `[N, 1, 3]` and the others `[N, K - 1, 3]`, where `n_coeffs` is K.
    pub fn apart(dc: &'a [T], rest: &'a [T], n_coeffs: usize) -> Self {
        Self {
            dc,
            rest,
            strides: [3, 3 * (n_coeffs - 1)],
            n_coeffs,
        }
    }

    /// K.
    pub fn n_coeffs(&self) -> usize {
        self.n_coeffs
    }

    /// Of Gaussian `i`: the constant one's three channels, and all channels of the others that a degree has.
    #[inline(always)]
    pub(super) fn row(&self, i: usize, sh_degree: usize) -> (&'a [T; 3], &'a [T]) {
        let dc = self.dc[i * self.strides[0]..].first_chunk();
        let rest = match sh_degree {
            0 => &[],
            _ => &self.rest[i * self.strides[1]..][..3 * (sh::N_COEFFS[sh_degree] - 1)],
        };
        (dc.expect("three channels"), rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Camera;
    use crate::project::{Gaussians, ProjectOptions, View, project, reference};
    use crate::splats::N_COLUMNS;
    use crate::testing::{assert_agrees, devices, normals, rng, tensor, to_f32, to_f64, values};

    const N: usize = 40;

    fn random(seed: u64, width: usize) -> Vec<f32> {
        to_f32(&normals(&mut rng(seed), N * width))
    }

    #[test]
    fn joined_and_apart_again() {
        for device in devices() {
            for k in [1, 4] {
                let all = random(1, 3 * k);
                let apart = ShCoeffs::from(tensor(&all, [N, k, 3], &device));
                assert_eq!(apart.rest.dims(), [N, k - 1, 3]);
                let dc: Vec<f32> = all
                    .chunks(3 * k)
                    .flat_map(|row| &row[..3])
                    .copied()
                    .collect();
                assert_eq!(values(apart.dc.clone()), dc);
                assert_eq!(values(apart.joined()), all);
            }
        }
    }

    /// What is learned apart has gradients apart, and none where none is asked for.
    #[test]
    fn gradients_apart_match_the_reference() {
        let (means, quats) = (random(2, 3), random(3, 4));
        let means: Vec<f32> = means
            .chunks(3)
            .flat_map(|m| [m[0], m[1], 5.0 + m[2]])
            .collect();
        let (scales, opacities) = (vec![-2.0; 3 * N], vec![1.0; N]);
        let v_splats = random(4, N_COLUMNS);
        let camera = Camera::new(40.0, 40.0, 32.0, 24.0, 64, 48);
        let options = ProjectOptions::default();
        for (degree, k) in [(0, 1), (1, 4), (3, 16)] {
            let (dc, rest) = (random(5, 3), random(6, 3 * (k - 1)));
            let wide = [&means, &quats, &scales, &opacities, &dc, &rest].map(|v| to_f64(v));
            let gaussians = Gaussians {
                means: &wide[0],
                quats: &wide[1],
                scales: &wide[2],
                opacities: &wide[3],
                sh_coeffs: ShSlices::apart(&wide[4], &wide[5], k),
            };
            let view = View::new(&camera, &options, degree);
            let expected = reference::project_vjp(&gaussians, &view, &to_f64(&v_splats));
            assert!(expected.v_sh_dc.iter().filter(|v| **v != 0.0).count() > N);
            for device in devices() {
                let device = device.autodiff();
                for tracked in [[true, true], [true, false], [false, true]] {
                    let place = |values: &[f32], width: usize, tracked: bool| {
                        let tensor = tensor(values, [N, width, 3], &device);
                        tensor.set_require_grad(tracked)
                    };
                    let coeffs = ShCoeffs {
                        dc: place(&dc, 1, tracked[0]),
                        rest: place(&rest, k - 1, tracked[1]),
                    };
                    let splats = project(
                        tensor(&means, [N, 3], &device),
                        tensor(&quats, [N, 4], &device),
                        tensor(&scales, [N, 3], &device),
                        tensor(&opacities, [N], &device),
                        coeffs.clone(),
                        &camera,
                        &options,
                    )
                    .expect("fits");
                    let v_splats = tensor(&v_splats, [N, N_COLUMNS], &device);
                    let grads = (splats * v_splats).sum().backward();
                    let parts = [
                        (coeffs.dc, &expected.v_sh_dc),
                        (coeffs.rest, &expected.v_sh_rest),
                    ];
                    for ((part, expected), tracked) in parts.into_iter().zip(tracked) {
                        let name = format!("{device:?}, degree {degree}, {tracked}");
                        match part.grad(&grads) {
                            Some(got) => assert_agrees(&name, &values(got), expected),
                            None => assert!(!tracked || expected.is_empty(), "{name}"),
                        }
                        assert!(part.grad(&grads).is_none() || tracked, "{name}");
                    }
                }
            }
        }
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        for device in devices() {
            let part = |n: usize, k: usize| Tensor::<3>::zeros([n, k, 3], &device);
            let refused = |dc, rest| {
                let coeffs = ShCoeffs { dc, rest };
                coeffs.check(2).expect_err("refused").to_string()
            };
            assert!(refused(part(3, 1), part(3, 3)).contains("`sh_coeffs.dc` has shape"));
            assert!(refused(part(2, 1), part(3, 3)).contains("`sh_coeffs.rest` has shape"));
            let coeffs = ShCoeffs {
                dc: part(2, 1),
                rest: part(2, 3),
            };
            assert_eq!(coeffs.check(2).expect("fits"), 4);
        }
    }
}
