//! COLMAP's text model files.

use std::path::Path;
use std::str::FromStr;

use super::rows::{ModelCamera, ModelImage};
use crate::Error;
use crate::ply::PointCloud;

pub(crate) fn cameras(path: &Path, text: &str) -> Result<Vec<ModelCamera>, Error> {
    let mut cameras = Vec::new();
    for (number, line) in content(text) {
        let mut fields = Fields::new(path, number, line);
        cameras.push(ModelCamera {
            id: fields.next("camera id")?,
            model: fields.next("camera model")?,
            width: fields.next("width")?,
            height: fields.next("height")?,
            // A camera that no image uses may be of any kind.
            parameters: fields.any("camera parameters")?,
        });
    }
    Ok(cameras)
}

pub(crate) fn images(path: &Path, text: &str) -> Result<Vec<ModelImage>, Error> {
    let mut images = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        if !is_content(line) {
            continue;
        }
        let mut fields = Fields::new(path, number, line);
        fields.next::<u32>("image id")?;
        let quaternion = fields.array("image rotation")?;
        let translation = fields.array("image translation")?;
        let camera_id = fields.next("image camera")?;
        let name = fields.remainder("image name")?;
        images.push(ModelImage {
            quaternion,
            translation,
            camera_id,
            name,
        });
        // The line after an image lists its observations and is empty when there are none.
        if let Some((number, line)) = lines.next()
            && is_content(line)
            && !is_observations(line)
        {
            let name = images.last().map_or("", |image| image.name.as_str());
            return Err(Error::invalid(
                path,
                format!("the observations of image `{name}` or an empty line"),
                format!("another image in line {}", number + 1),
                "leave an empty line after each image",
            ));
        }
    }
    Ok(images)
}

/// The points, and how many were not finite and left out.
pub(crate) fn points(path: &Path, text: &str) -> Result<(PointCloud, usize), Error> {
    let mut points = PointCloud::default();
    let mut dropped = 0;
    for (number, line) in content(text) {
        let mut fields = Fields::new(path, number, line);
        fields.next::<u64>("point id")?;
        let position = fields.array("point position")?;
        if !points.push_finite(position, fields.array("point colour")?) {
            dropped += 1;
        }
    }
    Ok((points, dropped))
}

pub(crate) fn content(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .filter(|(_, line)| is_content(line))
}

fn is_content(line: &str) -> bool {
    !line.trim().is_empty() && !line.trim_start().starts_with('#')
}

/// Whether a line has only numbers, three for each observation.
fn is_observations(line: &str) -> bool {
    let mut fields = line.split_ascii_whitespace();
    fields.clone().count().is_multiple_of(3) && fields.all(|field| field.parse::<f64>().is_ok())
}

/// The fields of one line.
pub(crate) struct Fields<'a> {
    path: &'a Path,
    line_index: usize,
    /// What was not read yet.
    left: &'a str,
}

impl<'a> Fields<'a> {
    pub(crate) fn new(path: &'a Path, line_index: usize, line: &'a str) -> Self {
        Self {
            path,
            line_index,
            left: line,
        }
    }

    /// The next field as it stands.
    fn field(&mut self) -> Option<&'a str> {
        let left = self.left.trim_ascii_start();
        let end = left.find(|c: char| c.is_ascii_whitespace());
        let (field, left) = left.split_at(end.unwrap_or(left.len()));
        self.left = left;
        (!field.is_empty()).then_some(field)
    }

    fn malformed(&self, what: &str, found: &str) -> Error {
        Error::invalid(
            self.path,
            what,
            format!("{found} in line {}", self.line_index + 1),
            "export the model again (`colmap model_converter`)",
        )
    }

    pub(crate) fn next<T: FromStr>(&mut self, what: &str) -> Result<T, Error> {
        let field = self
            .field()
            .ok_or_else(|| self.malformed(what, "the end"))?;
        field
            .parse()
            .map_err(|_| self.malformed(what, &format!("`{field}`")))
    }

    pub(crate) fn array<T: FromStr + Copy + Default, const N: usize>(
        &mut self,
        what: &str,
    ) -> Result<[T; N], Error> {
        let mut values = [T::default(); N];
        for value in &mut values {
            *value = self.next(what)?;
        }
        Ok(values)
    }

    pub(crate) fn rest<T: FromStr>(&mut self, what: &str) -> Result<Vec<T>, Error> {
        let mut values = vec![self.next(what)?];
        values.extend(self.any(what)?);
        Ok(values)
    }

    /// As [`Fields::rest`]; there may be none.
    fn any<T: FromStr>(&mut self, what: &str) -> Result<Vec<T>, Error> {
        let mut values = Vec::new();
        while let Some(field) = self.field() {
            values.push(
                field
                    .parse()
                    .map_err(|_| self.malformed(what, &format!("`{field}`")))?,
            );
        }
        Ok(values)
    }

    /// All that is left of the line, with the spaces within it.
    fn remainder(&mut self, what: &str) -> Result<String, Error> {
        match std::mem::take(&mut self.left).trim_ascii() {
            "" => Err(self.malformed(what, "the end")),
            text => Ok(text.to_string()),
        }
    }
}
