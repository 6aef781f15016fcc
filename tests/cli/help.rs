//! What the command says about itself.

use crate::support::surflux;

const SCENE: &str = "--point-light --background";
const TRANSPORT: &str = "--device --gather --atlas-format --face-resolution --surfels --surfel-spacing --surfels-per-primitive \
                         --surfel-cloud --surfel-shape --quality --lod --near-field --interpolate --bounces --light-samples --gather-samples --batch \
                         --frames-in-flight --seed --threads --validate --vulkan-route --quiet --verbose --help --version";

const SWEEP: &str = "--point-light --background --vary --quality --only-listed --gather --device --atlas-format --face-resolution --surfels \
                     --surfel-spacing --lod --near-field --interpolate --bounces --light-samples --gather-samples \
                     --samples --reference --reference-noise --mask --measure --repeat --json --plot --against --with \
                     --width --height --seed --threads --look-from --look-at --up --fov --quiet --verbose --help \
                     --version";

/// Options start their line after at most so many spaces; descriptions, which may start with an option's name, after more.
const INDENT: usize = 6;

/// Options that a help text lists, each at the start of its line.
fn listed(help: &str) -> Vec<&str> {
    let starts = help.lines().filter_map(|line| {
        let start = line.trim_start();
        start.strip_prefix('-').filter(|_| line.len() - start.len() <= INDENT)
    });
    let long = starts.filter_map(|line| line.split_whitespace().find_map(|word| word.strip_prefix('-')));
    let mut names: Vec<&str> = long.map(|word| word.trim_end_matches(',').trim_start_matches('-')).collect();
    names.sort_unstable();
    names
}

#[test]
fn every_command_lists_all_of_its_options() {
    for (command, own) in [
        (
            "render",
            "--output --width --height --samples --exposure --aov --stats --timeline --look-from --look-at --up --fov --verify \
             --target-error --time-budget",
        ),
        ("irradiance", "--emitters --only"),
        ("surfels", "--output --ascii"),
    ] {
        let expected = [own, SCENE, TRANSPORT].join(" ");
        assert_lists(command, &expected);
    }
    assert_lists("compare", "--diff --mask --max-mae --max-relmse --json --help --version");
    assert_lists(
        "latency",
        "--device --face-resolution --surfels --lod --effort --largest-batch --simulate-link --simulate-speed --json --plot --threads \
         --validate --look-from --look-at --up --fov --quiet --verbose --help --version",
    );
    assert_lists("devices", "--verbose --help --version");
    assert_lists("sweep", SWEEP);
}

fn assert_lists(command: &str, options: &str) {
    let help = surflux(&[command, "--help"]).expect(0);
    let mut expected: Vec<&str> = options.split(' ').map(|option| option.trim_start_matches('-')).collect();
    expected.sort_unstable();
    assert_eq!(listed(&help.stdout), expected, "{command}");
    let short = surflux(&[command, "-h"]).expect(0).stdout;
    assert_eq!(listed(&short), expected, "{command}");
}

#[test]
fn the_overview_names_all_commands_and_exit_codes() {
    let help = surflux(&["--help"]).expect(0).stdout;
    for word in ["render", "irradiance", "surfels", "compare", "sweep", "latency", "devices", "0 done", "130"]
    {
        assert!(help.contains(word), "{word}: {help}");
    }
}

#[test]
fn the_version_is_the_package_s() {
    let version = concat!("surflux ", env!("CARGO_PKG_VERSION"), "\n");
    assert_eq!(surflux(&["--version"]).expect(0).stdout, version);
}

#[test]
fn misspelt_options_and_commands_are_corrected() {
    let option = surflux(&["render", "a.pov", "-o", "a.png", "--face-res", "8"]).expect(2);
    assert!(option.stderr.contains("--face-resolution"), "{}", option.stderr);
    let command = surflux(&["rendr", "a.pov"]).expect(2);
    assert!(command.stderr.contains("'render'"), "{}", command.stderr);
}
