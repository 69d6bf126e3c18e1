#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| kinelm_fuzz::glb(data));
