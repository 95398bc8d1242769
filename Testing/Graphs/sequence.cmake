# cmake -DPROGRAM=quell -DSCENE=file.gltf -DWORK=dir -P sequence.cmake
# A run that fails in the middle goes on where it stopped, refuses to go on with anything else, and gives the same pixels as
# an uninterrupted one; what it wrote can be run again by itself.
include("${CMAKE_CURRENT_LIST_DIR}/program.cmake")

file(WRITE "${WORK}/noise.xml" [=[<pipeline version="1">
  <variable name="scene" type="path" default="scene.gltf"/>
  <time count="6"/>
  <node id="pt" type="PathTraceSource">
    <property name="Scene" value="$(scene)"/>
    <property name="Width" value="24"/><property name="Height" value="16"/><property name="SamplesPerPixel" value="1"/>
  </node>
  <output name="beauty" from="pt:radiance" file="noise.####.exr"><property name="Half" value="1"/></output>
</pipeline>]=])
file(WRITE "${WORK}/smooth.xml" [=[<pipeline version="1">
  <time count="6"/>
  <node id="in" type="ImageReader"><property name="File" value="noise.####.exr"/></node>
  <node id="taa" type="TemporalAntialias">
    <property name="Alpha" value="0.5"/>
    <input port="radiance" from="in:radiance"/>
    <input port="history" from="taa:radiance" delay="1"/>
  </node>
  <output name="beauty" from="taa:radiance" file="smooth.####.exr"/>
</pipeline>]=])

# Without history: frames whose files are there are not made again.
quell(0 "no frame is finished" run noise.xml -D scene=${SCENE} --resume --quiet)
quell(0 "half [R G B]" inspect noise.0003.exr)
quell(0 "nothing to do: all 6 frames are there" run noise.xml -D scene=${SCENE} --resume --quiet)
file(RENAME "${WORK}/noise.0002.exr" "${WORK}/kept.exr")
quell(2 "noise.0000.exr was made by another pipeline or other options" run noise.xml -D scene=${SCENE} --resume --quiet --seed 5)
expect("a refused run wrote something" NOT EXISTS "${WORK}/noise.0002.exr")
file(SHA256 "${WORK}/noise.0001.exr" before)
quell(0 "5 of 6 frames are there already" run noise.xml -D scene=${SCENE} --resume --quiet)
file(SHA256 "${WORK}/noise.0001.exr" after)
expect("a finished frame was made again" before STREQUAL after)
same(noise.0002.exr kept.exr)

# With history: the checkpoint.
quell(0 "wrote 6 frames" run smooth.xml --out whole --quiet)
# What an image says it was made by makes it again, to the last bit: a frame with history, a crop, a changed one.
quell(0 "is what its pipeline makes" verify whole/smooth.0005.exr --quiet)
quell(0 "radiance: every bit of 384 pixels" verify whole/smooth.0003.exr --quiet)
quell(0 "wrote crop/smooth.0004.exr" run smooth.xml --frames 4 --region 3,2,17,11 --quiet --out crop)
quell(0 "radiance: every bit of 126 pixels" verify crop/smooth.0004.exr --quiet)
quell(0 "wrote" run noise.xml -D scene=${SCENE} --frames 3 --quiet --out other --seed 9)
quell(0 "is what" verify other/noise.0003.exr --quiet)
file(RENAME "${WORK}/noise.0003.exr" "${WORK}/mine.exr")
file(COPY "${WORK}/other/noise.0003.exr" DESTINATION "${WORK}")
quell(3 "pixels differ, by" verify whole/smooth.0005.exr --quiet)
file(REMOVE "${WORK}/noise.0003.exr")
file(RENAME "${WORK}/mine.exr" "${WORK}/noise.0003.exr")
expect("the checkpoint was left behind" NOT EXISTS "${WORK}/whole/smooth.checkpoint")
quell(0 "there is no checkpoint part/smooth.checkpoint; starting from frame 0" run smooth.xml --out part --frames 0:1 --resume --quiet)
file(REMOVE "${WORK}/noise.0003.exr")
quell(1 "--resume goes on after frame 2" run smooth.xml --out part --quiet)
expect("no checkpoint" EXISTS "${WORK}/part/smooth.checkpoint")
file(RENAME "${WORK}/kept.exr" "${WORK}/noise.0003.exr")  # another picture than it was: still the same run
file(SHA256 "${WORK}/part/smooth.checkpoint" before)
quell(2 "node \"taa\": Alpha was 0.5 and is 0.25" run smooth.xml --out part --resume --quiet --set taa.Alpha=0.25)
quell(2 "--region: was the whole frame and is 0,0,8,8" run smooth.xml --out part --resume --quiet --region 0,0,8,8)
quell(2 "which leaves none of the frames 0:1" run smooth.xml --out part --resume --quiet --frames 0:1)
quell(0 "nothing to do: all 3 frames are there" run smooth.xml --out part --resume --quiet --frames 0:2)
file(SHA256 "${WORK}/part/smooth.checkpoint" after)
expect("a refused run changed the checkpoint" before STREQUAL after)
expect("a refused run wrote a frame" NOT EXISTS "${WORK}/part/smooth.0003.exr")
quell(0 "going on after frame 2, from part/smooth.checkpoint" run smooth.xml --out part --resume --quiet)
expect("the checkpoint was left behind" NOT EXISTS "${WORK}/part/smooth.checkpoint")
quell(0 "wrote 6 frames" run smooth.xml --out again --quiet)
foreach (i RANGE 0 5)
  same(part/smooth.000${i}.exr again/smooth.000${i}.exr)
endforeach ()

file(WRITE "${WORK}/part/smooth.checkpoint" "QUELLCKP and then nothing that makes sense")
quell(2 "checkpoint part/smooth.checkpoint: " run smooth.xml --out part --resume --quiet)

# From the middle.
quell(0 "those before them would have had a weight of at most 0.12" run smooth.xml --frames 5 --warmup-tolerance 0.2 --out late --quiet)
quell(0 "the bits are those of a run from the first frame" run smooth.xml --frames 5 --out late --quiet)
same(late/smooth.0005.exr again/smooth.0005.exr)

# What was written is a pipeline, from anywhere.
file(MAKE_DIRECTORY "${WORK}/far")
file(COPY "${WORK}/again/smooth.0005.exr" DESTINATION "${WORK}/far")
quell(0 "no mistakes; 2 nodes, 1 output, 6 frames" check far/smooth.0005.exr)
quell(0 "history <- taa:radiance of the previous frame" explain far/smooth.0005.exr)
quell(0 "wrote 6 frames" run far/smooth.0005.exr --out far/made --quiet)
same(far/made/smooth.0005.exr far/smooth.0005.exr)
quell(0 "wrote far/noise.0004.exr" run noise.0000.exr --frames 4 --quiet --out far)
same(far/noise.0004.exr noise.0004.exr)
file(WRITE "${WORK}/noise.0000.exr" "gone")
quell(2 "noise.0000.exr" run far/smooth.0005.exr --quiet)
file(GLOB all "${WORK}/noise.*.exr")
file(REMOVE ${all})
quell(2 "no such file" run far/smooth.0005.exr --quiet)

# Memory.
quell(2 "--memory 0.001: the run needs 170.0 MB, 170.0 MB of it the program, most of the rest in \"" run far/smooth.0005.exr --set in.File=far/smooth.0005.exr --memory 0.001)

# What the arrays of a frame promise each other, and motion against the frame before.
get_filename_component(data "${SCENE}" DIRECTORY)
quell(0 "wrote 2 frames" run "${data}/../Pipelines/aov.xml" -D scene=${SCENE} -D width=48 -D height=32 -D frames=2 --out aov --quiet)
quell(0 "  radiance = emission + direct + indirect: 100 % of 1536 pixels" inspect aov/out/aov.0001.exr)
quell(0 "  position is seen in its own pixel (within 1.5): 100 %" inspect aov/out/aov.0001.exr)
quell(0 "  motion is that of position under the camera of the frame before" inspect aov/out/aov.0001.exr)
