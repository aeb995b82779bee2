//! What is measured of a run: its quality, and what it costs.

use super::plot::Scale;
use super::runs::End;
use crate::evaluate::CurveLine;

const MEBIBYTE: f64 = (1 << 20) as f64;

/// A score along a run and at its end.
pub(super) struct Metric {
    pub(super) label: &'static str,
    pub(super) decimals: usize,
    pub(super) along: fn(&CurveLine) -> Option<f64>,
    pub(super) end: fn(&End) -> Option<f64>,
}

pub(super) const METRICS: [Metric; 6] = [
    Metric {
        label: "PSNR (dB)",
        decimals: 2,
        along: |line| line.psnr,
        end: |end| end.psnr,
    },
    Metric {
        label: "PSNR, moving pixels (dB)",
        decimals: 2,
        along: |line| line.psnr_dynamic,
        end: |end| end.psnr_dynamic,
    },
    Metric {
        label: "SSIM",
        decimals: 4,
        along: |line| line.ssim,
        end: |end| end.ssim,
    },
    Metric {
        label: "MS-SSIM",
        decimals: 4,
        along: |line| line.ms_ssim,
        end: |end| end.ms_ssim,
    },
    Metric {
        label: "LPIPS, VGG (lower is better)",
        decimals: 4,
        along: |line| line.lpips_vgg,
        end: |end| end.lpips_vgg,
    },
    Metric {
        label: "LPIPS, Alex (lower is better)",
        decimals: 4,
        along: |line| line.lpips_alex,
        end: |end| end.lpips_alex,
    },
];

/// What a run costs at its end.
pub(super) struct Cost {
    pub(super) label: &'static str,
    pub(super) scale: Scale,
    pub(super) decimals: usize,
    pub(super) end: fn(&End) -> Option<f64>,
}

pub(super) const COSTS: [Cost; 4] = [
    Cost {
        label: "Gaussians",
        scale: Scale::Linear,
        decimals: 0,
        end: |end| Some((end.n_static + end.n_dynamic) as f64),
    },
    Cost {
        label: "pictures per second",
        scale: Scale::Linear,
        decimals: 1,
        end: |end| end.render_fps,
    },
    Cost {
        label: "scene on disk (MiB)",
        scale: Scale::Linear,
        decimals: 1,
        end: |end| Some(end.storage_bytes as f64 / MEBIBYTE),
    },
    Cost {
        label: "peak memory (MiB)",
        scale: Scale::Linear,
        decimals: 0,
        end: |end| Some(end.peak_memory_bytes? as f64 / MEBIBYTE),
    },
];
