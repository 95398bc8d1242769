#!/usr/bin/env bash
# Makes the references again (a few minutes): Data/Images/make-references.sh
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
quell=${QUELL:-$here/../../build/bin/quell}
cd "$here"
"$quell" run reference.xml --frames 31:31
"$quell" run noisy.xml

# The same picture as three plain files, inputs of denoise-images.xml.
oiiotool noisy.exr --ch R,G,B --eraseattrib 'quell:.*' -d half -o noisy-color.exr
oiiotool noisy.exr --ch R=albedo.R,G=albedo.G,B=albedo.B --eraseattrib 'quell:.*' -d half -o noisy-albedo.exr
oiiotool noisy.exr --ch R=N.X,G=N.Y,B=N.Z --eraseattrib 'quell:.*' -d half -o noisy-normal.exr

# A piece of two frames of Blender (CC0, made for this project), inputs of denoise-blender.xml.
frames=../../../shared/data/denoise-cycles-room
if [ -d "$frames" ]; then
  channels=
  for pass in Combined DiffDir DiffInd DiffCol GlossDir GlossInd GlossCol Emit; do
    channels+="ViewLayer.$pass.R,ViewLayer.$pass.G,ViewLayer.$pass.B,"
  done
  channels+="ViewLayer.Normal.X,ViewLayer.Normal.Y,ViewLayer.Normal.Z,ViewLayer.Vector.X,ViewLayer.Vector.Y"
  channels+=",ViewLayer.Vector.Z,ViewLayer.Vector.W,ViewLayer.Depth.Z,ViewLayer.IndexOB.X"
  for frame in 0001 0002; do
    oiiotool "$frames/noisy.$frame.exr" --ch "$channels" --cut 64x64+120+120 -d half -d ViewLayer.Depth.Z=float \
      --compression zip -o "blender.$frame.exr"
  done
fi
