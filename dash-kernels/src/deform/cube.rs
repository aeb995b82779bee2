//! Deformation on CubeCL devices. A unit owns a Gaussian. No shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{Columns, Deform, DeformVjp, Form, MEAN, QUAT, SCALE};
use crate::cube::{WORD_BYTES, arg, contiguous, uninitialised, units};
use crate::displacement::cube::{displaced, values};
use crate::host::dims;

impl Deform for CubeBackend {
    fn deform(
        means: CubeTensor,
        quats: CubeTensor,
        scales: CubeTensor,
        coefficients: CubeTensor,
        offsets: CubeTensor,
        form: Form,
    ) -> (CubeTensor, CubeTensor, CubeTensor) {
        let [means, quats, scales, coefficients, offsets] =
            [means, quats, scales, coefficients, offsets].map(contiguous);
        let [n, width] = dims::<2>(&offsets);
        let Form { columns, basis } = form;
        let has_path = !basis.is_empty();
        // The outputs share memory, so that the kernel has no more buffers than browsers bind.
        let alignment = means.client.properties().memory.alignment as usize;
        let parts = Parts::of(n, columns, alignment.div_ceil(WORD_BYTES));
        let memory = uninitialised(&means, [parts.end]);
        let part = |first: usize, end: usize, like: &CubeTensor| {
            let bytes = |values: usize| (values * WORD_BYTES) as u64;
            let handle = memory.handle.clone();
            CubeTensor {
                handle: handle
                    .offset_start(bytes(first))
                    .offset_end(bytes(parts.end - end)),
                ..like.clone()
            }
        };
        // No device binds an empty buffer.
        let values = match has_path {
            true => values(&means.client, &basis),
            false => values(&means.client, &[0.0]),
        };
        let (count, dim) = units(&means.client, n);
        deform_kernel::launch(
            &means.client,
            count,
            dim,
            EllipsoidsLaunch::new(arg(&means), arg(&quats), arg(&scales)),
            arg(&coefficients),
            values.arg(),
            arg(&offsets),
            arg(&memory),
            SizesLaunch::new(
                columns.mean_factor,
                n as u32,
                basis.len() as u32,
                parts.quats as u32,
                parts.scales as u32,
            ),
            width,
            Places::of(columns),
            has_path,
        );
        (
            part(0, parts.quats, &means),
            match columns.quats {
                Some(_) => part(parts.quats, parts.scales, &quats),
                None => quats,
            },
            match columns.scales {
                Some(_) => part(parts.scales, parts.end, &scales),
                None => scales,
            },
        )
    }
}

impl DeformVjp for CubeBackend {
    fn deform_vjp(
        v_means: CubeTensor,
        v_quats: CubeTensor,
        v_scales: CubeTensor,
        width: usize,
        columns: Columns,
    ) -> CubeTensor {
        let [v_means, v_quats, v_scales] = [v_means, v_quats, v_scales].map(contiguous);
        let [n, _] = dims::<2>(&v_means);
        let v_offsets = uninitialised(&v_means, [n, width]);
        let (count, dim) = units(&v_means.client, n);
        deform_vjp_kernel::launch(
            &v_means.client,
            count,
            dim,
            EllipsoidsLaunch::new(arg(&v_means), arg(&v_quats), arg(&v_scales)),
            arg(&v_offsets),
            columns.mean_factor,
            n as u32,
            width,
            Places::of(columns),
        );
        v_offsets
    }
}

/// Where the outputs begin in the memory that they share, in values, and its length.
struct Parts {
    quats: usize,
    scales: usize,
    end: usize,
}

impl Parts {
    /// Means, then what has offsets, each from a multiple of `alignment` on.
    fn of(n: usize, columns: Columns, alignment: usize) -> Self {
        let size = |first: Option<usize>, size: usize| match first {
            Some(_) => (n * size).next_multiple_of(alignment),
            None => 0,
        };
        let quats = (n * MEAN).next_multiple_of(alignment);
        let scales = quats + size(columns.quats, QUAT);
        Self {
            quats,
            scales,
            end: scales + size(columns.scales, SCALE),
        }
    }
}

/// The first columns of quaternions and scales.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Places {
    quats: Option<usize>,
    scales: Option<usize>,
}

impl Places {
    fn of(columns: Columns) -> Self {
        Self {
            quats: columns.quats,
            scales: columns.scales,
        }
    }
}

#[derive(CubeType, CubeLaunch)]
struct Ellipsoids {
    means: Box<[f32]>,  // [N, 3]
    quats: Box<[f32]>,  // [N, 4]
    scales: Box<[f32]>, // [N, 3]
}

/// `out = values + offsets`, `size` values of Gaussian `i` and the columns from `first` on; outputs begin at `start`.
#[cube]
fn add_row(
    values: &[f32],  // [N, size]
    offsets: &[f32], // [N, width]
    out: &mut [f32], // [start + N * size]
    start: usize,
    i: usize,
    #[comptime] size: usize,
    #[comptime] width: usize,
    #[comptime] first: usize,
) {
    #[unroll]
    for k in 0..size {
        out[start + i * size + k] = values[i * size + k] + offsets[i * width + first + k];
    }
}

/// How many there are of everything.
#[derive(CubeType, CubeLaunch)]
struct Sizes {
    /// Factor of the means' offsets.
    mean_factor: f32,
    /// Gaussians.
    n: u32,
    /// Functions of a path.
    n_functions: u32,
    /// Where quaternions begin in the output.
    from_quats: u32,
    /// Where scales begin.
    from_scales: u32,
}

#[cube(launch)]
fn deform_kernel(
    canonical: Ellipsoids, // means [N, 3], quaternions [N, 4], scales [N, 3]
    coefficients: &[f32],  // [N, B * 3]
    basis: &[f32],         // [B]
    offsets: &[f32],       // [N, width]
    deformed: &mut [f32],  // means [N, 3], then quaternions and scales
    sizes: Sizes,
    #[comptime] width: usize,
    #[comptime] places: Places,
    #[comptime] has_path: bool,
) {
    let i = ABSOLUTE_POS;
    if i >= sizes.n as usize {
        terminate!();
    }
    #[unroll]
    for k in 0..MEAN {
        let at = i * MEAN + k;
        let mut mean = canonical.means[at];
        if comptime!(has_path) {
            mean += displaced(coefficients, basis, i, k, sizes.n_functions as usize);
        }
        deformed[at] = mean + sizes.mean_factor * offsets[i * width + k];
    }
    if comptime!(places.quats.is_some()) {
        add_row(
            &canonical.quats,
            offsets,
            deformed,
            sizes.from_quats as usize,
            i,
            QUAT,
            width,
            comptime!(places.quats.unwrap_or(0)),
        );
    }
    if comptime!(places.scales.is_some()) {
        add_row(
            &canonical.scales,
            offsets,
            deformed,
            sizes.from_scales as usize,
            i,
            SCALE,
            width,
            comptime!(places.scales.unwrap_or(0)),
        );
    }
}

#[cube(launch)]
fn deform_vjp_kernel(
    gradients: Ellipsoids, // of the outputs, of their shapes
    v_offsets: &mut [f32], // [N, width]
    mean_factor: f32,
    n: u32,
    #[comptime] width: usize,
    #[comptime] places: Places,
) {
    let i = ABSOLUTE_POS;
    if i >= n as usize {
        terminate!();
    }
    let row = i * width;
    #[unroll]
    for k in 0..width {
        if comptime!(k < MEAN) {
            v_offsets[row + k] = mean_factor * gradients.means[i * MEAN + k];
        } else if comptime!(within(k, places.quats, QUAT)) {
            let own = comptime!(k - places.quats.unwrap_or(0));
            v_offsets[row + k] = gradients.quats[i * QUAT + own];
        } else if comptime!(within(k, places.scales, SCALE)) {
            let own = comptime!(k - places.scales.unwrap_or(0));
            v_offsets[row + k] = gradients.scales[i * SCALE + own];
        } else {
            v_offsets[row + k] = 0.0f32;
        }
    }
}

/// Whether a column is one of `size` columns.
fn within(column: usize, first: Option<usize>, size: usize) -> bool {
    first.is_some_and(|first| (first..first + size).contains(&column))
}
