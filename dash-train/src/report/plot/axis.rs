//! Axes: ranges, ticks and how numbers are written.

/// How values become positions along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scale {
    /// Evenly.
    #[default]
    Linear,
    /// By their logarithm; values of zero and less have no place.
    Log,
}

/// What an axis is of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Axis {
    /// The quantity and its unit.
    pub label: String,
    /// How values are spread.
    pub scale: Scale,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            scale: Scale::Linear,
        }
    }

    /// A logarithmic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            scale: Scale::Log,
        }
    }
}

/// Empty room at either end, as a share of the range.
const MARGIN: f64 = 0.06;
/// A range whose low end is this near to zero, in shares of its high end, begins at zero.
const NEAR_ZERO: f64 = 0.25;
/// Powers of ten outside of these are written as such.
const PLAIN_POWERS: std::ops::RangeInclusive<i32> = -2..=4;

/// The part of an axis that is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) struct Range {
    scale: Scale,
    /// Ends, in logarithms where the scale is.
    low: f64,
    high: f64,
}

/// A value with its text.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Tick {
    pub(in super::super) value: f64,
    pub(in super::super) label: String,
}

impl Range {
    /// The range that shows all values; [0, 1] or [1, 10] when there are none.
    pub(in super::super) fn around(scale: Scale, values: impl Iterator<Item = f64>) -> Self {
        let ends = values
            .filter(|&v| shown(scale, v))
            .map(|v| if scale == Scale::Log { v.log10() } else { v })
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| {
                [low.min(v), high.max(v)]
            });
        let [mut low, mut high] = match ends {
            [low, high] if low > high => [0.0, 1.0],
            [0.0, 0.0] if scale == Scale::Linear => [0.0, 1.0],
            ends => ends,
        };
        if high - low < 1e-9 * high.abs().max(1e-12) {
            let room = if scale == Scale::Log {
                0.3
            } else {
                (0.1 * high.abs()).max(1e-3)
            };
            (low, high) = (low - room, high + room);
        }
        let margin = MARGIN * (high - low);
        let from_zero = scale == Scale::Linear && low >= 0.0 && low < NEAR_ZERO * high;
        Self {
            scale,
            low: if from_zero { 0.0 } else { low - margin },
            high: high + margin,
        }
    }

    /// Where a value is, from 0 at the low end to 1; `None` where it has no place.
    pub(in super::super) fn place(&self, value: f64) -> Option<f64> {
        if !shown(self.scale, value) {
            return None;
        }
        let value = match self.scale {
            Scale::Linear => value,
            Scale::Log => value.log10(),
        };
        Some((value - self.low) / (self.high - self.low))
    }

    /// About `count` ticks at round values.
    pub(in super::super) fn ticks(&self, count: usize) -> Vec<Tick> {
        let count = count.max(2) as f64;
        match self.scale {
            Scale::Linear => self.linear_ticks(count),
            Scale::Log => self.log_ticks(count),
        }
    }

    fn linear_ticks(&self, count: f64) -> Vec<Tick> {
        let rough = (self.high - self.low) / count;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|m| m * power)
            .into_iter()
            .find(|&step| step >= rough * 0.999)
            .unwrap_or(10.0 * power);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let first = (self.low / step - 1e-6).ceil() as i64;
        let last = (self.high / step + 1e-6).floor() as i64;
        (first..=last)
            .map(|k| {
                let value = k as f64 * step;
                Tick {
                    value,
                    label: with_separators(value, decimals),
                }
            })
            .collect()
    }

    fn log_ticks(&self, count: f64) -> Vec<Tick> {
        let decades = self.high - self.low;
        // Fewer decades have ticks between the powers of ten.
        let factors: &[u32] = match decades {
            d if d < 1.0 => &[1, 2, 3, 5, 7],
            d if d < 1.4 => &[1, 2, 5],
            d if d < 2.6 => &[1, 3],
            _ => &[1],
        };
        let stride = (decades / count).ceil().max(1.0) as i32;
        let powers = self.low.floor() as i32..=self.high.ceil() as i32;
        let inside = |value: f64| {
            let place = value.log10();
            place >= self.low - 1e-9 && place <= self.high + 1e-9
        };
        let found: Vec<(u32, i32)> = powers
            .filter(|power| power.rem_euclid(stride) == 0)
            .flat_map(|power| factors.iter().map(move |&factor| (factor, power)))
            .filter(|&(factor, power)| inside(f64::from(factor) * 10f64.powi(power)))
            .collect();
        let plain = found.iter().all(|(_, power)| PLAIN_POWERS.contains(power));
        found
            .into_iter()
            .map(|(factor, power)| {
                let value = f64::from(factor) * 10f64.powi(power);
                let label = match (plain, factor) {
                    (true, _) => with_separators(value, (-power).max(0) as usize),
                    (false, 1) => power_of_ten(power),
                    (false, factor) => format!("{factor}·{}", power_of_ten(power)),
                };
                Tick { value, label }
            })
            .collect()
    }
}

/// Whether a value has a place on an axis.
pub(in super::super) fn shown(scale: Scale, value: f64) -> bool {
    value.is_finite() && (scale == Scale::Linear || value > 0.0)
}

fn power_of_ten(power: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let digits = power.unsigned_abs().to_string();
    let raised = digits
        .bytes()
        .map(|digit| DIGITS[usize::from(digit - b'0')]);
    let sign = if power < 0 { "⁻" } else { "" };
    format!("10{sign}{}", raised.collect::<String>())
}

/// A number with thousands apart.
pub(in super::super) fn with_separators(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    let (whole, rest) = text.split_at(text.find('.').unwrap_or(text.len()));
    let mut out = String::new();
    for (i, digit) in whole.chars().enumerate() {
        if i > 0 && (whole.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    let negative = value < 0.0 && text.bytes().any(|b| (b'1'..=b'9').contains(&b));
    format!("{}{out}{rest}", if negative { "−" } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale, values: &[f64], count: usize) -> Vec<String> {
        let ticks = Range::around(scale, values.iter().copied()).ticks(count);
        ticks.into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn ticks_are_round() {
        let linear = |values: &[f64]| labels(Scale::Linear, values, 4);
        assert_eq!(linear(&[2.0, 100.0]), ["0", "50", "100"]);
        assert_eq!(linear(&[31.2, 32.7]), ["31.5", "32.0", "32.5"]);
        assert_eq!(linear(&[0.0, 12_345.0]), ["0", "5,000", "10,000"]);
        assert_eq!(linear(&[-2.0, 2.0]), ["−2", "0", "2"]);
        let log = |values: &[f64]| labels(Scale::Log, values, 5);
        assert_eq!(log(&[1.0, 900.0]), ["1", "10", "100", "1,000"]);
        assert_eq!(
            log(&[2e-7, 3e-5]),
            ["3·10⁻⁷", "10⁻⁶", "3·10⁻⁶", "10⁻⁵", "3·10⁻⁵"]
        );
        assert_eq!(log(&[3.0, 21.0]), ["3", "5", "7", "10", "20"]);
        assert!(log(&[1e-20, 1e20]).len() <= 7);
    }

    #[test]
    fn what_has_no_place_is_not_placed() {
        let values = [f64::NAN, 0.0, -1.0, 10.0, 1000.0, f64::INFINITY];
        let range = Range::around(Scale::Log, values.into_iter());
        assert_eq!(range.place(0.0), None);
        assert_eq!(range.place(f64::NAN), None);
        let low = range.place(10.0).expect("on the axis");
        let high = range.place(1000.0).expect("on the axis");
        assert!(0.0 < low && low < high && high < 1.0);
        for values in [vec![], vec![7.0], vec![7.0, 7.0], vec![0.0]] {
            for scale in [Scale::Linear, Scale::Log] {
                let range = Range::around(scale, values.iter().copied());
                assert!(range.high > range.low, "{values:?} {range:?}");
                assert!(!range.ticks(4).is_empty(), "{values:?} {range:?}");
            }
        }
    }
}
