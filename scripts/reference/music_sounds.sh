#!/usr/bin/env bash
# Half a second of a rising tone in each coding, for crates/music/tests/read.rs: crates/music/tests/sounds.
#
#   apt-get install ffmpeg      (5.1.9 was used)
#   scripts/reference/music_sounds.sh
set -euo pipefail
cd "$(dirname "$0")/../../crates/music/tests/sounds"
tone='sin(2*PI*(200+600*t)*t)'
make() { ffmpeg -v error -y -f lavfi -i "aevalsrc=0.4*$tone|0.2*$tone:s=$1:d=0.5" -map_metadata -1 -bitexact "${@:2}"; }
make 22050 -c:a flac tone.flac
make 22050 -c:a libvorbis -q 4 tone.ogg
make 22050 -c:a libmp3lame -q 4 -write_xing 1 -id3v2_version 0 tone.mp3
make 22050 -c:a aac -b:a 64k tone.m4a
make 24000 -c:a libopus -b:a 32k tone.opus
make 22050 -c:a pcm_u8 tone-u8.wav
make 22050 -c:a pcm_s24le -t 0.1 tone-24.wav
make 22050 -c:a pcm_f32le -t 0.1 tone-f32.wav
ffmpeg -v error -y -f lavfi -i testsrc=d=0.1:s=32x32 -map_metadata -1 -bitexact -c:v mpeg4 silent.mp4
