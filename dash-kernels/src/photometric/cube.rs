//! The photometric loss on CubeCL devices: two kernels beside those of the similarity.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use super::{PhotometricLoss, PhotometricVjp};
use crate::cube::contiguous;
use crate::ssim::cube::loss;

impl PhotometricLoss for CubeBackend {
    fn photometric(image: CubeTensor, target: CubeTensor, dssim: f32) -> (CubeTensor, CubeTensor) {
        let ([loss, mse], _) = Self::photometric_and_gradient(image, target, dssim);
        (loss, mse)
    }
}

impl PhotometricVjp for CubeBackend {
    fn photometric_and_gradient(
        image: CubeTensor,
        target: CubeTensor,
        dssim: f32,
    ) -> ([CubeTensor; 2], CubeTensor) {
        loss::photometric(&contiguous(image), &contiguous(target), dssim)
    }
}
