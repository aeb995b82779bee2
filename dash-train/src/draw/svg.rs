//! A drawing as an `svg` element.

use std::fmt::Write;

use super::escape::escaped;
use super::ink::hex;
use super::{Anchor, Drawing, Ink, Mark, Shape};

/// The element. Colours stand in attributes and in classes, which a page's style may override.
pub(super) fn element(drawing: &Drawing, description: &str) -> String {
    let (width, height) = (drawing.width, drawing.height);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
         width=\"{width:.0}\" role=\"img\" aria-label=\"{}\" font-family=\"Ubuntu, Helvetica Neue, \
         Arial, Liberation Sans, sans-serif\">\n",
        escaped(description)
    );
    for shape in &drawing.shapes {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{}", shape_element(shape));
    }
    out.push_str("</svg>");
    out
}

fn shape_element(shape: &Shape) -> String {
    match shape {
        Shape::Line {
            points,
            ink,
            width,
            dashed,
        } => {
            let dashes = if *dashed {
                " stroke-dasharray=\"5 4\""
            } else {
                ""
            };
            format!(
                "<polyline points=\"{}\" fill=\"none\" {} stroke-width=\"{width}\" \
                 stroke-linejoin=\"round\" stroke-linecap=\"round\"{dashes}/>",
                coordinates(points),
                stroke(*ink)
            )
        }
        Shape::Area {
            points,
            ink,
            opacity,
        } => format!(
            "<polygon points=\"{}\" {} fill-opacity=\"{opacity}\"/>",
            coordinates(points),
            fill(*ink)
        ),
        Shape::Point {
            at,
            mark,
            ink,
            radius,
            tip,
        } => {
            let title = if tip.is_empty() {
                String::new()
            } else {
                format!("<title>{}</title>", escaped(tip))
            };
            match mark {
                Mark::Circle => format!(
                    "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\" {}>{title}</circle>",
                    at[0],
                    at[1],
                    fill(*ink)
                ),
                other => format!(
                    "<polygon points=\"{}\" {}>{title}</polygon>",
                    coordinates(&other.outline(*at, *radius)),
                    fill(*ink)
                ),
            }
        }
        Shape::Ring { at, ink, radius } => format!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\" fill=\"none\" {} stroke-width=\"1.3\"/>",
            at[0],
            at[1],
            stroke(*ink)
        ),
        Shape::Text {
            at,
            text,
            ink,
            size,
            anchor,
            bold,
        } => {
            let anchor = match anchor {
                Anchor::Start => "",
                Anchor::Middle => " text-anchor=\"middle\"",
                Anchor::End => " text-anchor=\"end\"",
            };
            let weight = if *bold { " font-weight=\"600\"" } else { "" };
            format!(
                "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"{size}\" {}{anchor}{weight}>{}</text>",
                at[0],
                at[1],
                fill(*ink),
                escaped(text)
            )
        }
    }
}

fn fill(ink: Ink) -> String {
    format!("class=\"f-{}\" fill=\"{}\"", ink.class(), hex(ink.light()))
}

fn stroke(ink: Ink) -> String {
    format!(
        "class=\"s-{}\" stroke=\"{}\"",
        ink.class(),
        hex(ink.light())
    )
}

fn coordinates(points: &[[f64; 2]]) -> String {
    let pairs: Vec<String> = points
        .iter()
        .map(|[x, y]| format!("{x:.1},{y:.1}"))
        .collect();
    pairs.join(" ")
}
