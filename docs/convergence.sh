#!/usr/bin/env bash
# Measures and draws what docs/convergence.md tells. What has been rendered already, in target/convergence, is not rendered again;
# remove that folder to begin anew. About five minutes on two idle cores.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --release
results=target/convergence
mkdir -p "$results" docs/convergence

scenes=(three-spheres open-sky cornell-measured)
camera() {
    case $1 in
    cornell-measured) echo scenes/cornell-measured.obj --look-from 278,273,-800 --look-at 278,273,0 --fov 39.3077 ;;
    *) echo "scenes/$1.pov" ;;
    esac
}

# study NAME OPTION...: a sweep of each scene.
study() {
    local name=$1 scene
    shift
    for scene in "${scenes[@]}"; do
        echo "$name, $scene"
        # shellcheck disable=SC2046 # the words of a camera are words of the command
        target/release/surflux sweep $(camera "$scene") --only-listed --quality reference --measure indirect "$@" \
            --json "$results/$name-$scene.jsonl"
    done
}

# figure NAME FILE SETTING OPTION...: all scenes of a study in one plot over a setting.
figure() {
    local name=$1 file=$2 setting=$3 last=${scenes[-1]} scene with=()
    shift 3
    for scene in "${scenes[@]:0:${#scenes[@]}-1}"; do
        with+=(--with "$results/$name-$scene.jsonl")
    done
    # shellcheck disable=SC2046
    target/release/surflux sweep $(camera "$last") --only-listed --quality reference --measure indirect "$@" \
        --json "$results/$name-$last.jsonl" "${with[@]}" --plot "docs/convergence/$file.svg" --against "$setting" >/dev/null
}

every_point=(--interpolate off --width 64 --height 64 --reference-noise 1e-4)

together=("${every_point[@]}" --vary together --lod 0.5 --face-resolution 4,8,16,32 --surfels 1000,4000,16000,64000)
study together "${together[@]}"
figure together together face-resolution "${together[@]}"

resolution=("${every_point[@]}" --lod 0.5 --surfels 16000 --face-resolution 4,8,16,32)
study resolution "${resolution[@]}"
figure resolution face-resolution face-resolution "${resolution[@]}"

each=("${every_point[@]}" --vary each --face-resolution 32 --surfels 1000,4000,16000,64000 --lod 0.5,1,2,4,8 --near-field 0,1,2,4,8)
study each "${each[@]}"
for setting in surfels lod near-field; do
    figure each "$setting" "$setting" "${each[@]}"
done

tolerance=(--width 200 --height 200 --reference-noise 1e-3 --interpolate off,0.0025,0.005,0.01,0.02,0.04,0.08)
study tolerance "${tolerance[@]}"
figure tolerance interpolate interpolate "${tolerance[@]}"
