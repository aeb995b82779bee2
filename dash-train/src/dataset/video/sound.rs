//! Which frames of a damaged video can be had.
//!
//! Pictures are coded as differences from earlier ones, and decoders go on after damage with pictures
//! that look nearly right. So of every group of pictures that does not decode as a whole, only what the
//! file holds before the damage counts.

use std::ops::Range;

use rayon::prelude::*;

use super::super::DatasetError;
use super::index::VideoIndex;
use super::{Part, decode_frames_with, failed};
use crate::video::ffmpeg_program;

impl VideoIndex {
    /// The same video, of which nothing that is damaged will be read. Decodes all of it, some of it
    /// several times.
    pub(in super::super) fn without_damage(&self) -> Self {
        let sound = (0..self.entries.len())
            .into_par_iter()
            .map(|number| self.sound_packets(number))
            .collect();
        let mut without = self.clone();
        without.sound = Some(sound);
        without
    }

    /// Whether the frame decodes, as far as [`without_damage`](Self::without_damage) has looked.
    pub(in super::super) fn is_sound(&self, frame: usize) -> bool {
        let Some(sound) = &self.sound else {
            return true;
        };
        let number = self.entries.partition_point(|&entry| entry <= frame);
        let number = number.saturating_sub(1);
        self.shown_of(number, sound[number]).contains(&frame)
    }

    /// An error that says which frames are damaged, and how the decoder first put it.
    pub(in super::super) fn damage(&self, reason: &DatasetError) -> DatasetError {
        let damaged: Vec<usize> = (0..self.n_frames())
            .filter(|&frame| !self.is_sound(frame))
            .collect();
        let runs: Vec<String> = damaged
            .chunk_by(|a, b| a + 1 == *b)
            .map(|run| match run {
                [first, .., last] => format!("{first} to {last}"),
                run => run.iter().map(ToString::to_string).collect(),
            })
            .collect();
        let reason = match reason {
            DatasetError::Video { reason, .. } => reason.clone(),
            other => other.to_string(),
        };
        let n = self.n_frames();
        let plural = if damaged.len() == 1 { "" } else { "s" };
        let which = format!("frame{plural} {} of 0 to {}", runs.join(", "), n - 1);
        failed(self.path(), format!("{which} ({reason})"))
    }

    /// How many coded pictures of a group decode, from its beginning.
    fn sound_packets(&self, number: usize) -> usize {
        let n = self.group(number).len();
        if self.decodes(number, n) {
            return n;
        }
        // The first `sound` decode, the first `damaged` don't.
        let (mut sound, mut damaged) = (0, n);
        while damaged - sound > 1 {
            let middle = sound.midpoint(damaged);
            if self.decodes(number, middle) {
                sound = middle;
            } else {
                damaged = middle;
            }
        }
        sound
    }

    /// Whether the first so many coded pictures of a group decode by themselves.
    fn decodes(&self, number: usize, n_packets: usize) -> bool {
        let program = ffmpeg_program();
        let part = Part {
            max_frames: None,
            max_packets: Some(n_packets),
            ..self.part(self.group(number))
        };
        let found =
            decode_frames_with(
                &program.to_string_lossy(),
                self.path(),
                &part,
                |_, _| Ok(()),
            );
        found.is_ok_and(|found| found == n_packets)
    }

    /// The frames of a group that are shown before anything that its first so many coded pictures lack.
    fn shown_of(&self, number: usize, n_packets: usize) -> Range<usize> {
        let group = self.group(number);
        let mut decoded = self.packets[group.start..group.start + n_packets].to_vec();
        decoded.sort_by(f64::total_cmp);
        let shown = self.times()[group.clone()]
            .iter()
            .zip(&decoded)
            .take_while(|(wanted, decoded)| wanted == decoded);
        group.start..group.start + shown.count()
    }
}
