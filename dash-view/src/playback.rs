//! The time: play, step, seek, loop.

/// Speeds that are offered, as multiples of the clip's own.
pub const SPEEDS: [f64; 7] = [0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// A clip's time, and how it passes.
///
/// ```
/// use dash_view::playback::Playback;
///
/// let mut clip = Playback::new(31, 30.0);
/// clip.advance(0.5);
/// assert_eq!(clip.frame(), 15);
/// clip.step(2);
/// assert_eq!((clip.frame(), clip.playing), (17, false));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Playback {
    /// In [0, 1] over the clip.
    time: f64,
    n_frames: usize,
    frame_rate: f64,
    /// Whether time passes.
    pub playing: bool,
    /// Whether it starts anew at the end.
    pub looping: bool,
    /// A multiple of the clip's own speed.
    pub speed: f64,
}

impl Playback {
    /// At the start of a clip of `n_frames`; plays where there is more than one.
    ///
    /// # Units
    /// `frame_rate` in frames per second.
    pub fn new(n_frames: usize, frame_rate: f64) -> Self {
        Self {
            time: 0.0,
            n_frames,
            frame_rate,
            playing: n_frames > 1,
            looping: true,
            speed: 1.0,
        }
    }

    /// In [0, 1] over the clip.
    pub fn time(&self) -> f32 {
        self.time as f32
    }

    /// Frames of the clip.
    pub fn n_frames(&self) -> usize {
        self.n_frames
    }

    /// The frame nearest to the time.
    pub fn frame(&self) -> usize {
        (self.time * self.last_frame()).round() as usize
    }

    fn last_frame(&self) -> f64 {
        self.n_frames.saturating_sub(1) as f64
    }

    /// Goes to a time in [0, 1]; times outside are brought to the nearest end.
    pub fn seek(&mut self, time: f64) {
        // A clip of one frame has no other time.
        self.time = match self.n_frames > 1 && time.is_finite() {
            true => time.clamp(0.0, 1.0),
            false => 0.0,
        };
    }

    /// Stops, and goes to the frame `by` frames from the nearest one.
    pub fn step(&mut self, by: i64) {
        self.playing = false;
        let frame = (self.frame() as f64 + by as f64).clamp(0.0, self.last_frame());
        self.seek(frame / self.last_frame().max(1.0));
    }

    /// Plays, from the start where the end was reached; or stops.
    pub fn toggle(&mut self) {
        self.playing = !self.playing && self.n_frames > 1;
        if self.playing && self.time >= 1.0 {
            self.time = 0.0;
        }
    }

    /// The next faster speed of [`SPEEDS`], or with `-1` the next slower one.
    pub fn change_speed(&mut self, by: i64) {
        let now = SPEEDS.iter().position(|s| *s >= self.speed).unwrap_or(0) as i64;
        let next = (now + by).clamp(0, SPEEDS.len() as i64 - 1);
        self.speed = SPEEDS[next as usize];
    }

    /// Lets time pass. At the end a loop begins anew; what does not loop stops.
    ///
    /// # Units
    /// `secs` in seconds.
    pub fn advance(&mut self, secs: f64) {
        if !self.playing {
            return;
        }
        let length = self.last_frame() / self.frame_rate;
        let time = self.time + self.speed * secs / length;
        match (time <= 1.0, self.looping) {
            (true, _) => self.time = time,
            (false, true) => self.time = time.rem_euclid(1.0),
            (false, false) => {
                self.time = 1.0;
                self.playing = false;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_plays_at_its_rate_and_loops() {
        let mut clip = Playback::new(31, 30.0);
        assert!(clip.playing);
        clip.advance(0.5);
        assert_eq!((clip.time(), clip.frame()), (0.5, 15));
        clip.speed = 2.0;
        clip.advance(0.35);
        assert!((clip.time() - 0.2).abs() < 1e-6, "{}", clip.time());
        clip.looping = false;
        clip.advance(10.0);
        assert_eq!((clip.time(), clip.playing), (1.0, false));
        clip.toggle();
        assert_eq!((clip.time(), clip.playing), (0.0, true));
    }

    #[test]
    fn steps_stop_at_both_ends() {
        let mut clip = Playback::new(5, 30.0);
        clip.step(-1);
        assert_eq!((clip.frame(), clip.playing), (0, false));
        for frame in [1, 2, 3, 4, 4] {
            clip.step(1);
            assert_eq!(clip.frame(), frame);
        }
        assert_eq!(clip.time(), 1.0);
        clip.seek(0.37);
        clip.step(0);
        assert_eq!(clip.time(), 0.25);
    }

    #[test]
    fn what_is_static_has_one_time() {
        let mut still = Playback::new(1, 30.0);
        still.toggle();
        still.advance(1.0);
        still.step(1);
        still.seek(0.7);
        assert_eq!(
            (still.time(), still.frame(), still.playing),
            (0.0, 0, false)
        );
        let mut clip = Playback::new(3, 30.0);
        clip.seek(f64::NAN);
        assert_eq!(clip.time(), 0.0);
    }

    #[test]
    fn speeds_have_a_slowest_and_a_fastest() {
        let mut clip = Playback::new(3, 30.0);
        for _ in 0..9 {
            clip.change_speed(1);
        }
        assert_eq!(clip.speed, 8.0);
        for _ in 0..9 {
            clip.change_speed(-1);
        }
        assert_eq!(clip.speed, 0.1);
    }
}
