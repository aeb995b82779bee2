//! Outlines and widths of text. The font comes with the program, since the machine may have none.

use std::sync::OnceLock;

use ab_glyph::{Font, FontRef, Outline};

/// How much wider than this font a page's may be.
const OTHER_FONTS: f64 = 1.08;

/// A minus that is an exponent's: the font has raised digits, but not this.
const RAISED_MINUS: char = '⁻';
/// Its size and height, in shares of the text's size.
const RAISED: [f64; 2] = [0.62, 0.3];

/// A character in text of size 1: its outline, y up, and how far it advances.
pub(super) struct Glyph {
    pub(super) outline: Option<Outline>,
    /// Units of the outline in text of size 1.
    pub(super) units: f64,
    /// How far it stands above the base line.
    pub(super) raised: f64,
    pub(super) advance: f64,
}

fn font() -> &'static FontRef<'static> {
    static FONT: OnceLock<FontRef<'static>> = OnceLock::new();
    FONT.get_or_init(|| {
        FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT)
            .expect("the font is part of the program")
    })
}

/// A character; one that the font lacks is its box.
pub(super) fn glyph(character: char) -> Glyph {
    let font = font();
    let (character, size, raised) = if character == RAISED_MINUS {
        ('−', RAISED[0], RAISED[1])
    } else {
        (character, 1.0, 0.0)
    };
    let id = font.glyph_id(character);
    let units = f64::from(font.units_per_em().unwrap_or(1000.0)) / size;
    Glyph {
        outline: font.outline(id),
        units,
        raised,
        advance: f64::from(font.h_advance_unscaled(id)) / units,
    }
}

/// Room that a text needs, in pixels, whatever font shows it.
pub(crate) fn text_width(text: &str, size: f64) -> f64 {
    advance(text, size) * OTHER_FONTS
}

/// Width of a text in this font, in pixels.
pub(super) fn advance(text: &str, size: f64) -> f64 {
    text.chars().map(|c| glyph(c).advance).sum::<f64>() * size
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_what_labels_are_written_with() {
        let missing = font().glyph_id('\u{e123}');
        for character in "AZaz09.,:;%()[]+-−×·–≤^²⁰¹²³⁴⁵⁶⁷⁸⁹".chars() {
            assert_ne!(font().glyph_id(character), missing, "{character}");
        }
        assert!(text_width("mmm", 10.0) > text_width("iii", 10.0));
        assert_eq!(text_width("", 10.0), 0.0);
    }
}
