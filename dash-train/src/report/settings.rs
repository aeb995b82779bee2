//! The settings that a reader needs to compare scores with other people's, for the captions.

use super::groups::RunGroup;
use super::runs::RunRecord;
use crate::evaluate::{MetricSettings, ROUNDING_RULE, resize_rule};
use crate::metrics::{MOVING_PIXELS_RULE, MS_SSIM_RULE, PSNR_RULE, SSIM_RULE};

/// How the pictures were made and measured. Where runs differ, it says so.
pub(super) fn pinned(groups: &[RunGroup]) -> String {
    let parts = [
        ("Resize", of_all(groups, resize)),
        ("rounding", of_all(groups, rounding)),
        ("background", of_all(groups, background)),
        ("SSIM", of_all(groups, ssim_window)),
        ("test views", of_all(groups, views)),
        (
            "device",
            of_all(groups, |run| run.config.data.device.clone()),
        ),
        ("CPU threads", of_all(groups, threads)),
    ];
    let parts: Vec<String> = parts
        .iter()
        .map(|(name, value)| format!("{name}: {value}"))
        .collect();
    parts.join("; ") + "."
}

/// How each score is taken, one sentence each.
pub(super) fn rules(groups: &[RunGroup]) -> Vec<(String, String)> {
    let rule = |of: fn(&RunRecord) -> String| of_all(groups, of);
    let settings = |of: fn(&MetricSettings) -> &String| {
        of_all(groups, |run| match &run.results {
            Some(results) => of(&results.evaluation.metric_settings).clone(),
            None => "not scored".into(),
        })
    };
    let from = |name: &str, value: String| (name.to_string(), value);
    let mut rules = vec![
        from("PSNR", PSNR_RULE.into()),
        from("moving pixels", MOVING_PIXELS_RULE.into()),
        from("SSIM", rule(ssim_window)),
        from("MS-SSIM", MS_SSIM_RULE.into()),
    ];
    let mut runs = groups.iter().flat_map(|group| &group.runs);
    if runs.any(|run| run.results.is_some()) {
        rules.push(from("LPIPS", settings(|of| &of.lpips)));
        rules.push(from("rendering speed", settings(|of| &of.render_fps)));
        rules.push(from("memory", settings(|of| &of.peak_memory)));
    }
    rules
}

fn of_all(groups: &[RunGroup], of: impl Fn(&RunRecord) -> String) -> String {
    let mut values: Vec<String> = Vec::new();
    for run in groups.iter().flat_map(|group| &group.runs) {
        let value = of(run);
        if !values.contains(&value) {
            values.push(value);
        }
    }
    match values.as_slice() {
        [] => "not recorded".into(),
        [one] => one.clone(),
        several => format!("differs between runs ({})", several.join(" | ")),
    }
}

fn resize(run: &RunRecord) -> String {
    match &run.results {
        Some(results) => results.evaluation.metric_settings.resize.clone(),
        None => resize_rule(run.config.data.downscale),
    }
}

fn rounding(run: &RunRecord) -> String {
    match &run.results {
        Some(results) => results.evaluation.metric_settings.rounding.clone(),
        None => ROUNDING_RULE.into(),
    }
}

fn background(run: &RunRecord) -> String {
    match &run.results {
        Some(results) => {
            let [r, g, b] = results.evaluation.metric_settings.background;
            format!("sRGB {r}, {g}, {b}")
        }
        None => "the dataset's own, or black".into(),
    }
}

fn ssim_window(run: &RunRecord) -> String {
    match &run.results {
        Some(results) => results.evaluation.metric_settings.ssim.clone(),
        None => SSIM_RULE.into(),
    }
}

fn views(run: &RunRecord) -> String {
    let at_end = run.end().map(|end| end.n_views);
    match (run.curve.last().map(|line| line.n_views), at_end) {
        (Some(along), Some(end)) if along != end => {
            format!("{along}, evenly spread, along the way; {end} at the end")
        }
        (Some(n), _) | (None, Some(n)) => n.to_string(),
        (None, None) => "none scored".into(),
    }
}

fn threads(run: &RunRecord) -> String {
    run.curve
        .last()
        .map_or("not recorded".into(), |line| line.threads.to_string())
}
