//! From our axes, x right, y down, z forward, to those of other formats and back.

use crate::GaussianRows;

/// A half-turn about one of the axes; twice is none.
#[derive(Debug, Clone, Copy)]
pub enum HalfTurn {
    /// To x right, y up, z backward: SPZ's.
    AboutX,
    /// To x left, y up, z forward: glTF's, whose assets face along z.
    AboutZ,
}

impl HalfTurn {
    /// Signs of x, y and z.
    fn signs(self) -> [f32; 3] {
        match self {
            Self::AboutX => [1.0, -1.0, -1.0],
            Self::AboutZ => [-1.0, -1.0, 1.0],
        }
    }

    /// The same Gaussians turned.
    pub fn of(self, mut rows: GaussianRows) -> GaussianRows {
        let signs = self.signs();
        let [x, y, z] = signs;
        for mean in &mut rows.means {
            *mean = std::array::from_fn(|axis| mean[axis] * signs[axis]);
        }
        // The rotation is conjugated with the turn: its axis turns with the others.
        for quat in &mut rows.quats {
            *quat = [quat[0], quat[1] * x, quat[2] * y, quat[3] * z];
        }
        // Signs of the products that the higher colour functions are.
        let sh_signs = [
            y,
            z,
            x,
            x * y,
            y * z,
            1.0,
            x * z,
            1.0,
            y,
            x * y * z,
            y,
            z,
            x,
            z,
            x,
        ];
        if rows.sh_rest_width > 0 {
            for row in rows.sh_rest.chunks_exact_mut(rows.sh_rest_width) {
                for (channels, sign) in row.as_chunks_mut::<3>().0.iter_mut().zip(sh_signs) {
                    *channels = channels.map(|value| value * sign);
                }
            }
        }
        rows
    }
}
