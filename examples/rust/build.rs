//! Links the library of the mast and copies the constants of its header into Rust.
//!
//! The environment variable MAST_BUNDLE names the folder that `tensegrity-codegen build --out` wrote.
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-env-changed=MAST_BUNDLE");
    let bundle = env::var_os("MAST_BUNDLE").unwrap_or_else(|| "../../output/examples/mast".into());
    let bundle = fs::canonicalize(Path::new(&bundle)).unwrap_or_else(|error| {
        panic!("MAST_BUNDLE: {}: {error}; build the library first", bundle.to_string_lossy())
    });
    println!("cargo:rustc-link-search=native={}", bundle.display());
    println!("cargo:rustc-link-lib=dylib=mast");
    println!("cargo:rustc-link-arg=-Wl,-rpath,{}", bundle.display());

    let header = bundle.join("mast.h");
    println!("cargo:rerun-if-changed={}", header.display());
    let text = fs::read_to_string(&header).expect("mast.h can be read");
    let target =
        PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join("constants.rs");
    fs::write(target, constants(&text)).expect("OUT_DIR can be written");
}

/// Returns `pub const NAME: usize = VALUE;` for each enumeration constant of the header, and for a table of
/// texts `mast_member_name[9][6]` the length of its texts, `MAST_MEMBER_NAME_LENGTH`.
fn constants(header: &str) -> String {
    let mut found = String::from("// Constants of mast.h.\n");
    for line in header.lines() {
        for entry in line.split(',') {
            let words = entry.trim().trim_start_matches("enum {").trim();
            if let Some((name, value)) = words.split_once(" = ") {
                let digits: String = value.chars().take_while(char::is_ascii_digit).collect();
                if name.starts_with("MAST_") && !digits.is_empty() {
                    found += &format!("pub const {name}: usize = {digits};\n");
                }
            }
        }
        if let Some((_, table)) = line.split_once("extern MAST_API const char ") {
            let parts: Vec<&str> = table.split(['[', ']']).collect();
            if let [name, _, "", length, ..] = parts[..] {
                found += &format!("pub const {}_LENGTH: usize = {length};\n", name.to_uppercase());
            }
        }
    }
    found
}
