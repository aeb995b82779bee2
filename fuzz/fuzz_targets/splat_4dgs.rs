#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| dash_fuzz::parse("splat_4dgs", bytes));
