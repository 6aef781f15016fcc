//! Keeps the committed SPIR-V in step with its GLSL: refuses a stale one, and rebuilds it on request.
//!
//! Two compilers can rebuild it: the `shaderc` crate (cargo feature `compile-shaders`), or a `glslc` that is installed
//! (environment variable `SURFLUX_GLSLC` with its path).

use std::error::Error;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Entry files and the variants that are compiled of each: output name and preprocessor definitions.
const VARIANTS: [(&str, &str, &[&str]); 11] = [
    ("splat.vert", "splat_disc.vert.spv", &[]),
    ("splat.frag", "splat_disc.frag.spv", &[]),
    ("splat.vert", "splat_triangle.vert.spv", &["TRIANGLE"]),
    ("splat.frag", "splat_triangle.frag.spv", &["TRIANGLE"]),
    ("splat.vert", "splat_disc_colour.vert.spv", &["COLOUR"]),
    ("splat.frag", "splat_disc_colour.frag.spv", &["COLOUR"]),
    ("splat.vert", "splat_triangle_colour.vert.spv", &["TRIANGLE", "COLOUR"]),
    ("splat.frag", "splat_triangle_colour.frag.spv", &["TRIANGLE", "COLOUR"]),
    ("gather.comp", "gather_disc.comp.spv", &[]),
    ("gather.comp", "gather_triangle.comp.spv", &["TRIANGLE"]),
    ("convolve.comp", "convolve.comp.spv", &[]),
];

const STALE: &str = "the SPIR-V in shaders/spirv is older than its GLSL in shaders: rebuild it with `cargo build --features \
compile-shaders` (needs cmake, python3 and a C++ compiler), or, where glslc is installed, with `SURFLUX_GLSLC=glslc cargo \
build`";

fn main() -> Outcome<()> {
    println!("cargo::rerun-if-changed=shaders");
    println!("cargo::rerun-if-env-changed=SURFLUX_GLSLC");
    let folder = Path::new("shaders");
    let recorded = folder.join("spirv/SOURCES.hash");
    let hash = format!("{:016x}\n", hash_of_sources(folder)?);
    if compile(folder)? {
        write_if_changed(&recorded, hash.as_bytes())?;
    } else if fs::read_to_string(&recorded).unwrap_or_default() != hash {
        println!("cargo::error={STALE}");
    }
    Ok(())
}

/// FNV-1a over the names and the contents of all GLSL files, in order of name. Line ends do not count: a checkout may
/// change them.
fn hash_of_sources(folder: &Path) -> Outcome<u64> {
    let mut sources: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Outcome<_>>()?;
    sources.retain(|path| {
        ["vert", "frag", "comp", "glsl"].iter().any(|e| path.extension() == Some(OsStr::new(e)))
    });
    sources.sort();
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for path in sources {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        for byte in name.bytes().chain(fs::read(&path)?).filter(|&byte| byte != b'\r') {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    Ok(hash)
}

/// Compiles all variants if a compiler is chosen; tells whether one was.
fn compile(folder: &Path) -> Outcome<bool> {
    for (source, target, definitions) in VARIANTS {
        let Some(code) = compile_one(&folder.join(source), definitions)? else { return Ok(false) };
        write_if_changed(&folder.join("spirv").join(target), &code)?;
    }
    Ok(true)
}

/// Leaves equal files alone, so that cargo does not see them change at every build.
fn write_if_changed(path: &Path, contents: &[u8]) -> Outcome<()> {
    if fs::read(path).is_ok_and(|old| old == contents) {
        return Ok(());
    }
    Ok(fs::write(path, contents)?)
}

#[cfg(not(feature = "compile-shaders"))]
fn compile_one(source: &Path, definitions: &[&str]) -> Outcome<Option<Vec<u8>>> {
    let Some(glslc) = std::env::var_os("SURFLUX_GLSLC") else { return Ok(None) };
    let target = PathBuf::from(std::env::var_os("OUT_DIR").ok_or("cargo sets OUT_DIR")?).join("shader.spv");
    let status = std::process::Command::new(glslc)
        .args(["--target-env=vulkan1.1", "-O", "-o"])
        .arg(&target)
        .args(definitions.iter().map(|name| format!("-D{name}")))
        .arg(source)
        .status()?;
    if !status.success() {
        return Err(format!("glslc could not compile {}", source.display()).into());
    }
    Ok(Some(fs::read(target)?))
}

#[cfg(feature = "compile-shaders")]
fn compile_one(source: &Path, definitions: &[&str]) -> Outcome<Option<Vec<u8>>> {
    let folder = source.parent().unwrap_or(Path::new(".")).to_path_buf();
    let mut options = shaderc::CompileOptions::new()?;
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_1 as u32);
    options.set_optimization_level(shaderc::OptimizationLevel::Performance);
    options.set_include_callback(move |name, _, _, _| {
        let path = folder.join(name);
        let content = fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok(shaderc::ResolvedInclude { resolved_name: path.display().to_string(), content })
    });
    definitions.iter().for_each(|name| options.add_macro_definition(name, None));
    let kind = match source.extension().and_then(OsStr::to_str) {
        Some("vert") => shaderc::ShaderKind::Vertex,
        Some("comp") => shaderc::ShaderKind::Compute,
        _ => shaderc::ShaderKind::Fragment,
    };
    let text = fs::read_to_string(source)?;
    let name = source.display().to_string();
    let artifact =
        shaderc::Compiler::new()?.compile_into_spirv(&text, kind, &name, "main", Some(&options))?;
    Ok(Some(artifact.as_binary_u8().to_vec()))
}
