//! Recordings as cameras and programs write them: when frames were taken, and how pictures are to be shown. The readers
//! and `prepare` must find the same.

mod colours;
mod footage;
mod pictures;
mod times;
mod tracks;
