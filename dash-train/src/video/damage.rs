//! Which frames of a damaged video still decode.
//!
//! Pictures are coded as differences from earlier ones. After damage, decoders go on with pictures that
//! look nearly right. So if a group of pictures does not decode as a whole, only its pictures before the
//! damage count.

use std::ops::Range;

use rayon::prelude::*;

use super::decode::{Portion, decode};
use super::index::VideoIndex;
use crate::Error;

impl VideoIndex {
    /// The same video without its damaged pictures. Decodes all of it, some of it several times.
    pub(crate) fn without_damage(&self) -> Self {
        let sound = (0..self.entries.len())
            .into_par_iter()
            .map(|number| self.sound_packets(number))
            .collect();
        let mut without = self.clone();
        without.sound = Some(sound);
        without
    }

    /// Whether the frame decodes, once [`without_damage`](Self::without_damage) has looked.
    pub(crate) fn is_sound(&self, frame: usize) -> bool {
        let Some(sound) = &self.sound else {
            return true;
        };
        let number = self.entries.partition_point(|&entry| entry <= frame);
        let number = number.saturating_sub(1);
        self.shown_of(number, sound[number]).contains(&frame)
    }

    /// The error that lists the damaged frames and quotes the decoder.
    pub(crate) fn damage(&self, reason: &Error) -> Error {
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
            Error::VideoDecode { reason, .. } => reason.clone(),
            other => other.to_string(),
        };
        let n = self.n_frames();
        let plural = if damaged.len() == 1 { "" } else { "s" };
        let which = format!("frame{plural} {} of 0 to {}", runs.join(", "), n - 1);
        Error::video_decode(self.path(), format!("{which} ({reason})"))
    }

    /// How many coded pictures of a group decode, from its beginning.
    fn sound_packets(&self, number: usize) -> usize {
        let n = self.group(number).len();
        if !self.is_timed {
            // Which pictures the first ones show is unknown.
            return 0;
        }
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

    /// Whether the first `n_packets` coded pictures of a group decode by themselves.
    fn decodes(&self, number: usize, n_packets: usize) -> bool {
        let part = Portion {
            max_frames: None,
            max_packets: Some(n_packets),
            ..self.part(self.group(number))
        };
        let found = decode(&self.track, &part, |_| Ok(()));
        found.is_ok_and(|found| found == n_packets)
    }

    /// The frames of a group that its first `n_packets` coded pictures show without a gap.
    fn shown_of(&self, number: usize, n_packets: usize) -> Range<usize> {
        let group = self.group(number);
        let mut decoded = self.packets[group.start..group.start + n_packets].to_vec();
        decoded.sort_unstable();
        let shown = self.stamps[group.clone()]
            .iter()
            .zip(&decoded)
            .take_while(|(wanted, decoded)| wanted == decoded);
        group.start..group.start + shown.count()
    }
}
