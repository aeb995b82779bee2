//! Colours.

use super::Ink;

/// Colours that series have; further ones begin anew.
pub(crate) const N_SERIES_COLORS: usize = 7;

/// Okabe and Ito's colours, told apart with any colour vision, without the yellow that white paper
/// swallows; on light paper.
const LIGHT: [[u8; 3]; N_SERIES_COLORS] = [
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x9e, 0x73],
    [0xb6, 0x4f, 0x8a],
    [0xc7, 0x87, 0x00],
    [0x3d, 0x9f, 0xdb],
    [0x55, 0x55, 0x55],
];
/// The same on dark paper.
const DARK: [[u8; 3]; N_SERIES_COLORS] = [
    [0x5a, 0xb4, 0xf0],
    [0xff, 0x8c, 0x42],
    [0x2f, 0xd0, 0xa2],
    [0xe8, 0x93, 0xc4],
    [0xf0, 0xb9, 0x3a],
    [0x9a, 0xd8, 0xff],
    [0xb5, 0xb5, 0xb5],
];
const LIGHT_ROLES: [[u8; 3]; 4] = [
    [0x1c, 0x1e, 0x21],
    [0x5c, 0x61, 0x66],
    [0xe3, 0xe5, 0xe8],
    [0xff, 0xff, 0xff],
];
const DARK_ROLES: [[u8; 3]; 4] = [
    [0xec, 0xed, 0xee],
    [0xa4, 0xa9, 0xae],
    [0x3a, 0x3e, 0x43],
    [0x17, 0x19, 0x1c],
];
const ROLE_CLASSES: [&str; 4] = ["text", "muted", "grid", "paper"];

impl Ink {
    fn role(self) -> Option<usize> {
        match self {
            Self::Text => Some(0),
            Self::Muted => Some(1),
            Self::Grid => Some(2),
            Self::Paper => Some(3),
            Self::Series(_) | Self::Rgb(_) => None,
        }
    }

    /// On light paper.
    pub(super) fn light(self) -> [u8; 3] {
        match (self.role(), self) {
            (Some(role), _) => LIGHT_ROLES[role],
            (None, Self::Series(n)) => LIGHT[n % N_SERIES_COLORS],
            (None, Self::Rgb(color)) => color,
            (None, _) => LIGHT_ROLES[0],
        }
    }

    /// The class that a page's style gives another colour on dark paper.
    pub(super) fn class(self) -> String {
        match self {
            Self::Series(n) => format!("c{}", n % N_SERIES_COLORS),
            Self::Rgb(_) => "own".into(),
            role => ROLE_CLASSES[role.role().unwrap_or(0)].into(),
        }
    }
}

/// `#rrggbb`.
pub(super) fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Rules of a style sheet with the colours on dark paper.
///
/// A class that begins with `f` fills, one that begins with `s` strokes.
pub(crate) fn dark_style() -> String {
    let roles = ROLE_CLASSES.iter().map(ToString::to_string).zip(DARK_ROLES);
    let series = (0..N_SERIES_COLORS).map(|n| (format!("c{n}"), DARK[n]));
    roles
        .chain(series)
        .map(|(class, color)| {
            let color = hex(color);
            format!("svg .f-{class}{{fill:{color}}}svg .s-{class}{{stroke:{color}}}")
        })
        .collect()
}
