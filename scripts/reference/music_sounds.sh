#!/usr/bin/env bash
# Half a second of a rising tone in each coding, and two seconds of clicks in files as they are sold, for
# crates/music/tests/read.rs: crates/music/tests/sounds. Prints the samples that ffmpeg decodes of each.
#
#   apt-get install ffmpeg lame      (5.1.9 and 3.100 were used)
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

# a click of 2 ms every quarter of a second; noise in the first or last six tenths of a second
clicks='0.9*lt(mod(t\,0.25)\,0.002)*sin(2*PI*1000*mod(t\,0.25))'
noise='lt(mod(t\,0.25)\,0.1)*0.4*(2*random(0)-1)'
beside=$(mktemp -d)
trap 'rm -r "$beside"' EXIT
song() { ffmpeg -v error -y -f lavfi -i "aevalsrc=$1:s=22050:d=2" -bitexact "$beside/$2.wav"; }
song "$clicks+lt(t\,0.6)*$noise" loud
song "$clicks+gt(t\,1.4)*$noise" quiet
song "$clicks" clicks
lame --quiet -V2 -t "$beside/loud.wav" v2-loud.mp3
lame --quiet -V2 -t "$beside/quiet.wav" v2-quiet.mp3
lame --quiet --abr 32 -t "$beside/loud.wav" abr-loud.mp3
lame --quiet --abr 32 -t "$beside/quiet.wav" abr-quiet.mp3
lame --quiet -b 16 -t "$beside/clicks.wav" cbr.mp3
lame --quiet -V9 "$beside/clicks.wav" "$beside/tagged.mp3"
ffmpeg -v error -y -ss 0.3 -i "$beside/tagged.mp3" -c copy cut.mp3
ffmpeg -v error -y -i "$beside/loud.wav" -c:a aac -b:a 32k -bitexact loud.aac
ffmpeg -v error -y -f lavfi -i testsrc=d=2:s=32x32:r=10 -i "$beside/clicks.wav" -map_metadata -1 -bitexact -c:v mpeg4 -bf 2 \
    -b:v 1k -c:a aac -b:a 32k picture.mp4
for name in v2-*.mp3 abr-*.mp3 cbr.mp3 cut.mp3 *.aac picture.mp4; do
    echo "$name $(($(ffmpeg -v error -i "$name" -map 0:a -f s16le -ac 1 - | wc -c) / 2))"
done
cat tone.mp3 tone.mp3 > "$beside/two.mp3"
echo "tone.mp3 twice $(($(ffmpeg -v error -i "$beside/two.mp3" -f s16le -ac 1 - | wc -c) / 2))"
