//! The program's man pages, one for each command, into a folder:
//! `cargo run --release --example man -- ~/.local/share/man/man1`

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [folder] = &args[..] else { return Err("the call is: man FOLDER".into()) };
    std::fs::create_dir_all(folder)?;
    clap_mangen::generate_to(kinelm::cli::parser(), folder)?;
    Ok(())
}
