#!/usr/bin/env bash
# Makes Documentation/frames.md and its pictures: the shipped pipelines on frames with references. Called by
# ./bootstrap.sh report frames [FOLDER]; FOLDER holds denoise-cycles-room and denoise-pbrt-gbuffer (../shared/data).
#   frames.sh SOURCE PROGRAM FOLDER
set -euo pipefail
source=$1 program=$2 data=$3
room=$data/denoise-cycles-room pbrt=$data/denoise-pbrt-gbuffer
for needed in "$room/noisy.0008.exr" "$room/reference.0008.exr" "$pbrt/gbuffer-8spp.exr" "$pbrt/reference-1024spp.exr"; do
  [ -e "$needed" ] || { echo "report frames: $needed is missing" >&2; exit 1; }
done
pipelines=$source/Data/Pipelines images=$source/Documentation/images/frames page=$source/Documentation/frames.md
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$images"

# run NAME PIPELINE ARGS...: its first EXR (the last frame's) is $work/NAME.exr
run() {
  local name=$1 pipeline=$2
  shift 2
  "$program" run "$pipelines/$pipeline" --quiet --out "$work/$name" "$@" >"$work/$name.log" || { cat "$work/$name.log" >&2; exit 1; }
  cp "$(ls "$work/$name"/out/*.exr | tail -n 1)" "$work/$name.exr"
}
# errors NAME REFERENCE: table cells
errors() {
  "$program" compare "$1" "$2" --metric relMSE --metric relMSE@0.1% --metric PSNR --metric SSIM |
    awk '{ printf "%s %.3g |", (NR > 1 ? "" : "|"), $2 }'
}
trimmed() { "$program" compare "$1" "$2" --metric relMSE@0.1% | awk '{ printf "%.3g", $2 }'; }
# part X0,Y0,X1,Y1 FILE OUT.exr
part() { "$program" run "$source/Testing/FilterStudy/crop.xml" --quiet -D "input=$2" --region "$1" --output "pt:radiance=$3" --out "$work" >/dev/null; }
region() { # X0,Y0,X1,Y1 FILE REFERENCE: relMSE and brightness against the reference's
  part "$1" "$2" "$work/part-a.exr"
  part "$1" "$3" "$work/part-b.exr"
  local a b
  a=$("$program" inspect "$work/part-a.exr" | sed -n 's/.*radiance: .*mean \([0-9.e+-]*\).*/\1/p' | head -n 1)
  b=$("$program" inspect "$work/part-b.exr" | sed -n 's/.*radiance: .*mean \([0-9.e+-]*\).*/\1/p' | head -n 1)
  printf ' %s (%s) |' "$("$program" compare "$work/part-a.exr" "$work/part-b.exr" --metric relMSE 2>/dev/null | awk '{ printf "%.3g", $2 }')" \
    "$(awk -v a="$a" -v b="$b" 'BEGIN { printf "%+.0f %%", 100 * (a / b - 1) }')"
}
# picture X0,Y0,X1,Y1 FILE NAME [STOPS]
picture() {
  "$program" run "$source/Testing/FilterStudy/crop.xml" --quiet -D "input=$2" -D "exposure=${4:-1}" --region "$1" --out "$work/crop" >/dev/null
  cp "$work/crop/crop.png" "$images/$3.png"
}
image() { printf ' <img src="images/frames/%s.png" width="%s"> |' "$1" "$2"; }

say() { printf 'report frames: %s\n' "$*" >&2; }
exec 3>"$work/page.md"

say "the Cycles room"
reference=$room/reference.0008.exr
run file denoise-file.xml -D "input=$room/noisy.0008.exr"
run gbuffer denoise-pbrt.xml -D "input=$room/noisy.0008.exr"
run alone denoise-blender.xml -D "input=$room/noisy.####.exr" -D first=8 -D frames=1
run svgf denoise-blender.xml -D "input=$room/noisy.####.exr" -D frames=8
run specks denoise-blender.xml -D "input=$room/noisy.####.exr" -D frames=8 --set direct/reproject.BackgroundHistory=1 \
  --set indirect/reproject.BackgroundHistory=1 --set specular/reproject.BackgroundHistory=1
cp "$room/noisy.0008.exr" "$work/noisy.exr"
block=54,107,116,219 caustic=28,198,54,218 shadow=100,205,170,255
cat >&3 <<TEXT
# Frames with references

Made by \`./bootstrap.sh report frames\` from the frames in \`../shared/data\` and from renders of its own; no figure in a
table is written by hand. relMSE is the mean of (a - r)² / (r² + 0.01); relMSE@0.1% leaves out the worst 0.1 % of the pixels.

## A room by Cycles

Eight frames of 256 x 256 pixels, two samples a pixel, a moving camera, a moving block, a block of glossy metal; frame 8
against its reference of 2048 samples. \`denoise-blender.xml\` (SVGF along the file's own motion vectors) has seen the eight
frames; the others have seen frame 8 alone.

| pipeline | relMSE | relMSE@0.1% | PSNR | SSIM | glossy block | floor beside it | shadow |
|---|---:|---:|---:|---:|---:|---:|---:|
TEXT
row() { printf '| %s %s%s%s%s\n' "$1" "$(errors "$work/$2.exr" "$reference")" "$(region $block "$work/$2.exr" "$reference")" \
  "$(region $caustic "$work/$2.exr" "$reference")" "$(region $shadow "$work/$2.exr" "$reference")" >&3; }
row unfiltered noisy
row '`denoise-file.xml`' file
row '`denoise-pbrt.xml`' gbuffer
row '`denoise-blender.xml`, frame 8 alone' alone
row '`denoise-blender.xml`, frames 1 to 8' svgf
best=$(printf '%s\n' "$(trimmed "$work/file.exr" "$reference")" "$(trimmed "$work/gbuffer.exr" "$reference")" | sort -g | head -n 1)
ours=$(trimmed "$work/svgf.exr" "$reference") single=$(trimmed "$work/alone.exr" "$reference")
times() { awk -v a="$1" -v b="$2" 'BEGIN { printf "%.1f", a / b }'; }
for name in noisy gbuffer alone svgf; do
  picture 48,100,128,226 "$work/$name.exr" "room-block-$name"
  picture 20,180,84,224 "$work/$name.exr" "room-floor-$name"
done
picture 48,100,128,226 "$reference" room-block-reference
picture 20,180,84,224 "$reference" room-floor-reference
for name in specks svgf; do
  picture 216,0,256,256 "$work/$name.exr" "room-background-$name" 3
done
picture 216,0,256,256 "$reference" room-background-reference 3
{
  cat <<TEXT

The last three columns are relMSE of a part of the picture and, in brackets, how much brighter or darker it is than the
reference. By relMSE@0.1% the sequence is $(times "$best" "$ours") times better than the best of the pipelines for single
files, and $(times "$single" "$ours") times better than the same pipeline without a past.

| | unfiltered | \`denoise-pbrt.xml\` | frame 8 alone | frames 1 to 8 | reference |
|---|---|---|---|---|---|
TEXT
  printf '| the glossy block |'
  for name in noisy gbuffer alone svgf reference; do image "room-block-$name" 160; done
  printf '\n| the floor beside it |'
  for name in noisy gbuffer alone svgf reference; do image "room-floor-$name" 160; done
  cat <<TEXT


- **The glossy block** shows what is reflected in it, and that moves otherwise than the block's own surface, which is where
  history is read. The pipeline gives glossy light a chain of its own with a short history (half of it is new every frame) and
  fewer passes. The reflection keeps its place and its outline blurs; the grain that is left is what two
  samples a pixel and a short history leave.
- **The floor beside the block** gets a patch of red light thrown by the metal: a caustic, found by few of the samples, each
  of which is far brighter than its surroundings. To a filter that is a firefly: the pipelines for single files clamp it and
  lose the part of the light that the brackets tell, and the patch's outline with it. The sequence keeps nearly all of its
  light, as what eight frames found adds up before it is filtered; but the a-trous passes let brightness differ by so many
  standard deviations, which are large there, so the outline is blurred all the same.
- **The shadow** moves with its block, and there the past is wrong: one frame alone is nearer to the reference. Direct light
  forgets half of its history every frame; a longer history lags behind visibly.

### The background has no history

A pixel at the edge of the room is background to depth and yet partly wall, so a part of the wall's light is in it. In the next
frame the wall has moved on. A history of the background keeps that light where it was, one n-th of it after n frames: the
specks on the left. \`Reproject\` therefore takes no history where nothing was hit (\`BackgroundHistory\` brings it back: for a
camera that stands still, partly covered pixels converge with it).

| | relMSE@0.1% | SSIM | right edge, 3 stops brighter |
|---|---:|---:|---|
TEXT
  for name in specks svgf; do
    printf '| %s | %s | %s |%s\n' "$([ $name = specks ] && echo 'with a history of the background' || echo 'without')" \
      "$(trimmed "$work/$name.exr" "$reference")" \
      "$("$program" compare "$work/$name.exr" "$reference" --metric SSIM | awk '{ printf "%.3f", $2 }')" "$(image "room-background-$name" 60)"
  done
  printf '| reference | | |%s\n' "$(image room-background-reference 60)"
} >&3

say "single frames"
for scene in cornell-box material-gallery; do
  for kind in noisy reference; do
    spp=8 seed=1
    [ $kind = reference ] && spp=256 seed=99
    run "$scene-$kind" aov.xml -D "scene=$source/Data/Scenes/$scene.gltf" -D "spp=$spp" -D "seed=$seed"
  done
done
cat >&3 <<TEXT

## One frame, many renderers

The two pipelines for single files, with their default settings, on every frame with a reference that is at hand:
relMSE@0.1%. They are one template; \`denoise-pbrt.xml\` filters albedo and normals before it, and takes differences of albedo up
to 0.1 for noise. The constants were chosen on the whole table, not on one of its rows. Alpha and roughness, where the file has
them, are guides: without alpha the light of a surface would be spread to pixels that the background covers in part, without
roughness a pattern that only roughness has would be lost in the highlights.

| frame | unfiltered | \`denoise-file.xml\` | \`denoise-pbrt.xml\` |
|---|---:|---:|---:|
TEXT
single() { # TITLE NOISY REFERENCE
  run one-file denoise-file.xml -D "input=$2"
  run one-pbrt denoise-pbrt.xml -D "input=$2"
  printf '| %s | %s | %s | %s |\n' "$1" "$(trimmed "$2" "$3")" "$(trimmed "$work/one-file.exr" "$3")" "$(trimmed "$work/one-pbrt.exr" "$3")" >&3
}
single "pbrt, Cornell box, gbuffer film, 8 samples, noisy albedo" "$pbrt/gbuffer-8spp.exr" "$pbrt/reference-1024spp.exr"
cp "$work/one-pbrt.exr" "$work/pbrt-filtered.exr"
single "Cycles, glossy room, frame 4, 2 samples" "$room/noisy.0004.exr" "$room/reference.0004.exr"
single "Cycles, glossy room, frame 8, 2 samples" "$room/noisy.0008.exr" "$room/reference.0008.exr"
single "Quell, Cornell box, 8 samples" "$work/cornell-box-noisy.exr" "$work/cornell-box-reference.exr"
single "Quell, material gallery, 8 samples" "$work/material-gallery-noisy.exr" "$work/material-gallery-reference.exr"
picture 0,0,256,110 "$pbrt/gbuffer-8spp.exr" pbrt-ceiling-noisy
picture 0,0,256,110 "$work/pbrt-filtered.exr" pbrt-ceiling-filtered
picture 0,0,256,110 "$pbrt/reference-1024spp.exr" pbrt-ceiling-reference
{
  cat <<TEXT

The rival that comes with pbrt reaches 0.0058 on the first row. What is left there is mostly mottling of the ceiling, where
little light arrives: patches as wide as the kernel, of the noise that 8 samples leave under a kernel of 21 x 21. A third pass
or a wider kernel smooths them and costs more elsewhere (when it was tried, the gallery came out a fifth worse), so there is none.

| unfiltered | \`denoise-pbrt.xml\` | reference |
|---|---|---|
TEXT
  printf '|%s%s%s\n' "$(image pbrt-ceiling-noisy 256)" "$(image pbrt-ceiling-filtered 256)" "$(image pbrt-ceiling-reference 256)"
} >&3

say "a lens out of focus"
lens="-D width=256 -D height=144 --set pt.LensBlades=0 --set pt.PixelFilter=Box"
run lens-reference depth-of-field.xml $lens -D spp=256 -D seed=98
run lens-noisy depth-of-field.xml $lens -D spp=4
run lens-aov aov.xml -D width=256 -D height=144 -D spp=4 --set pt.LensRadius=0.06
run lens-means denoise-pbrt.xml -D "input=$work/lens-aov.exr"
run lens-samples samples.xml
run lens-aov1 aov.xml -D width=256 -D height=144 -D spp=1 --set pt.LensRadius=0.06
run lens-one denoise-pbrt.xml -D "input=$work/lens-aov1.exr" -D noise=1
cat >&3 <<TEXT

## A lens out of focus

The scene of \`depth-of-field.xml\` with four samples a pixel, against the pipeline itself with 256. Behind a lens a pixel's
samples hit several surfaces; their mean albedo, normal and depth are those of none. A filter of means
(\`denoise-pbrt.xml\`, which takes the noise out of the features first) sees edges where there are none and keeps noise along
them; a filter of samples (\`samples.xml\`: \`SampleFilter\`, every sample with features of its own) knows which sample is whose
and averages to pixels afterwards. With one sample a pixel (last row) no pixel is mixed, but neighbours alternate between
surfaces at random: a filter of pixels then keeps them apart, dots and all, and only more samples help.

| pipeline | relMSE | relMSE@0.1% | PSNR | SSIM | picture |
|---|---:|---:|---:|---:|---|
TEXT
for entry in "lens-noisy:unfiltered, 4 samples" "lens-means:\`denoise-pbrt.xml\` on means of 4 samples" \
  "lens-samples:\`samples.xml\`, 4 samples one by one" "lens-one:\`denoise-pbrt.xml\`, 1 sample"; do
  name=${entry%%:*}
  picture 70,60,240,130 "$work/$name.exr" "$name" 0.5
  printf '| %s %s%s\n' "${entry#*:}" "$(errors "$work/$name.exr" "$work/lens-reference.exr")" "$(image "$name" 340)" >&3
done
picture 70,60,240,130 "$work/lens-reference.exr" lens-reference 0.5
printf '| reference | | | | |%s\n' "$(image lens-reference 340)" >&3
cp "$work/page.md" "$page"
echo "$page"
