//! A smaller deformation field: without heads, levels or unread entries.

use burn::module::Param;
use burn::tensor::Tensor;

use super::DynamicPart;
use crate::gaussians::to_host;
use crate::{Head, ModelError, OffsetPlacement, SceneSettings};

/// Adds a share of an offset to a parameter.
fn add<const D: usize>(parameter: &mut Param<Tensor<D>>, offset: Option<Tensor<D>>, share: f32) {
    if let Some(offset) = offset {
        *parameter = Param::from_tensor((parameter.val() + offset * share).detach());
    }
}

impl DynamicPart {
    /// The part without a head of its field. With [`OffsetPlacement::BeforeActivation`] the head's average offset over
    /// `times` is added to the canonical Gaussians.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn without_head(
        &self,
        settings: &SceneSettings,
        head: Head,
        times: &[f32],
    ) -> Result<Self, ModelError> {
        let mut part = self.clone();
        part.field = part.field.without_head(head);
        if settings.offsets == OffsetPlacement::AfterActivation {
            return Ok(part);
        }
        let own = &mut part.gaussians;
        for &time in times {
            let offsets = self.field.decode(self.features(time)?)?;
            let share = 1.0 / times.len() as f32;
            match head {
                Head::Rotation => add(&mut own.quats, offsets.quats, share),
                Head::Scale => add(&mut own.log_scales, offsets.scales, share),
                Head::Appearance => {
                    add(&mut own.opacity_logits, offsets.opacity_logits, share);
                    add(&mut own.sh_dc, offsets.sh_dc, share);
                }
            }
        }
        Ok(part)
    }

    /// The part without some levels of its field's hash grid; `typical` is [`DynamicPart::mean_features`].
    ///
    /// # Errors
    /// As [`DeformationField::without_levels`](crate::DeformationField::without_levels).
    ///
    /// # Example
    /// ```
    /// # use burn::tensor::Device;
    /// # use dash_model::*;
    /// # use rand::SeedableRng;
    /// # let device = Device::flex();
    /// # let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    /// # let grid = HashEncoderConfig::new(2, 8, [4, 4, 4, 2], [8, 8, 8, 4]);
    /// # let config = DeformationConfig::new(grid, 8);
    /// # let settings = SceneSettings::default();
    /// # let rows = GaussianRows::from_points(&[[0.0; 3], [0.5; 3]], &[[0.8; 3]; 2], 0, 0.1);
    /// # let part = DynamicPart {
    /// #     gaussians: Gaussians::from_rows(&rows, &device),
    /// #     field: DeformationField::new(&config, SpaceBox::fixed(1.0), &mut rng, &device)?,
    /// # };
    /// // Without the coarse level and the head for scales, and with zeros in the entries that no Gaussian reads.
    /// let times = [0.0, 0.5, 1.0];
    /// let typical = part.mean_features(&times)?;
    /// let pruned = part.without_levels(&[0], &typical)?;
    /// let pruned = pruned.without_head(&settings, Head::Scale, &times)?;
    /// let (pruned, [n_read, n_entries]) = pruned.without_unread().expect("a hash grid");
    /// assert!(n_read < n_entries);
    /// assert_eq!(pruned.field.config().encoder.pruned_levels, [0]);
    /// # Ok::<(), ModelError>(())
    /// ```
    pub fn without_levels(&self, pruned: &[usize], typical: &[f32]) -> Result<Self, ModelError> {
        let mut part = self.clone();
        part.field = part.field.without_levels(pruned, typical)?;
        Ok(part)
    }

    /// The part with zeros in the entries of its field's hash grid that its Gaussians read at no time, and the numbers of
    /// entries read and of all entries. It renders the same pictures. `None` where the field has no hash grid.
    pub fn without_unread(&self) -> Option<(Self, [usize; 2])> {
        let (field, counts) = self.field.without_unread(self.gaussians.means.val())?;
        let part = Self {
            gaussians: self.gaussians.clone(),
            field,
        };
        Some((part, counts))
    }

    /// The mean of the field's features over the Gaussians and `times`.
    ///
    /// # Errors
    /// When `times` is empty, or a shape does not fit.
    pub fn mean_features(&self, times: &[f32]) -> Result<Vec<f32>, ModelError> {
        let mut sum: Option<Tensor<2>> = None;
        for &time in times {
            let mean = self.features(time)?.mean_dim(0);
            sum = Some(match sum {
                Some(sum) => sum + mean,
                None => mean,
            });
        }
        let sum = sum.ok_or_else(|| ModelError::argument("times", "at least one", "none"))?;
        Ok(to_host(sum.detach() / times.len() as f32))
    }
}
