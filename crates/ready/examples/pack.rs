//! Makes the data of this crate from a trained run: `cargo run --release -p kinelm-ready --example pack -- RUN`.

use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let run = std::env::args().nth(1).ok_or("expected a RUN")?;
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    kinelm_ready::pack(Path::new(&run), &data)?;
    println!("{}", data.display());
    Ok(())
}
