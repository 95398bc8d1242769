# cmake -DPROGRAM=quell -DSCENE=file.gltf -DWORK=dir -P resume.cmake
# --resume goes on only with what it would have made itself: changed frames of a sequence, files that were cut off, files
# of others under the checkpoint's name.
include("${CMAKE_CURRENT_LIST_DIR}/program.cmake")
get_filename_component(WORK "${WORK}" REALPATH) # as the program sees its working directory

file(WRITE "${WORK}/noise.xml" [=[<pipeline version="1">
  <variable name="scene" type="path" default="none"/>
  <time count="5"/>
  <node id="pt" type="PathTraceSource">
    <property name="Scene" value="$(scene)"/>
    <property name="Width" value="24"/><property name="Height" value="48"/>
  </node>
  <output name="o" from="pt:radiance" file="in/noise.####.exr"/>
</pipeline>]=])
file(WRITE "${WORK}/plain.xml" [=[<pipeline version="1">
  <time count="5"/>
  <node id="in" type="ImageReader"><property name="File" value="in/noise.####.exr"/></node>
  <output name="o" from="in:radiance" file="plain.####.exr"/>
</pipeline>]=])
file(WRITE "${WORK}/smooth.xml" [=[<pipeline version="1">
  <time count="5"/>
  <node id="in" type="ImageReader"><property name="File" value="in/noise.####.exr"/></node>
  <node id="taa" type="TemporalAntialias">
    <input port="radiance" from="in:radiance"/>
    <input port="history" from="taa:radiance" delay="1"/>
  </node>
  <output name="o" from="taa:radiance" file="smooth.####.exr"/>
</pipeline>]=])
quell(0 "wrote 5 frames" run noise.xml -D scene=${SCENE} --quiet)
quell(0 "wrote 5 frames" run smooth.xml --quiet --out whole)
file(MAKE_DIRECTORY "${WORK}/other")
file(COPY "${WORK}/in/noise.0004.exr" DESTINATION "${WORK}/other")

# Without history: a frame whose input is another one now, and one that was cut off.
quell(0 "wrote 5 frames" run plain.xml --quiet)
quell(0 "nothing to do: all 5 frames are there" run plain.xml --quiet --resume)
file(RENAME "${WORK}/in/noise.0001.exr" "${WORK}/kept.exr")
file(COPY_FILE "${WORK}/other/noise.0004.exr" "${WORK}/in/noise.0001.exr")
quell(2 "plain.0001.exr was made by another state of the input file ${WORK}/in/noise.0001.exr" run plain.xml --quiet --resume)
quell(3 "in/noise.0001.exr has changed since plain.0001.exr was made" verify plain.0001.exr --quiet)
file(RENAME "${WORK}/kept.exr" "${WORK}/in/noise.0001.exr")
file(SIZE "${WORK}/plain.0002.exr" size)
math(EXPR size "${size} - 1")
execute_process(COMMAND head -c ${size} "${WORK}/plain.0002.exr" OUTPUT_FILE "${WORK}/cut.exr")
file(RENAME "${WORK}/cut.exr" "${WORK}/plain.0002.exr")
quell(0 "4 of 5 frames are there already" run plain.xml --quiet --resume)
same(plain.0002.exr in/noise.0002.exr)

# With history: what was read before the checkpoint must be as it was, what comes may be anything.
file(RENAME "${WORK}/in/noise.0003.exr" "${WORK}/kept.exr")
quell(1 "--resume goes on after frame 2" run smooth.xml --quiet)
file(RENAME "${WORK}/kept.exr" "${WORK}/in/noise.0003.exr")
# Runs that have nothing better to put there leave it: of fewer frames, of another pipeline of this name.
file(SHA256 "${WORK}/smooth.checkpoint" checkpoint)
quell(0 "smooth.checkpoint stays: --resume goes on after frame 2" run smooth.xml --quiet --frames 0:1)
file(READ "${WORK}/smooth.xml" text)
string(REPLACE "smooth.####" "another.####" text "${text}")
string(REPLACE "in/noise" "../in/noise" text "${text}")
file(WRITE "${WORK}/other/smooth.xml" "${text}")
quell(0 "smooth.checkpoint of another run is there" run other/smooth.xml --quiet --frames 0)
quell(2 "--stats smooth.checkpoint would write over a checkpoint" run smooth.xml --quiet --stats smooth.checkpoint)
file(SHA256 "${WORK}/smooth.checkpoint" now)
expect("the checkpoint is another one" now STREQUAL checkpoint)
file(RENAME "${WORK}/in/noise.0001.exr" "${WORK}/kept.exr")
file(COPY_FILE "${WORK}/other/noise.0004.exr" "${WORK}/in/noise.0001.exr")
quell(2 "the contents of ${WORK}/in/noise.0001.exr: was" run smooth.xml --quiet --resume)
file(REMOVE "${WORK}/in/noise.0001.exr")
quell(2 "the contents of ${WORK}/in/noise.0001.exr: was" run smooth.xml --quiet --resume)
file(RENAME "${WORK}/kept.exr" "${WORK}/in/noise.0001.exr")
# Everything that was asked for is there, as after a kill between the last frame and the end.
quell(0 "nothing to do: all 3 frames are there" run smooth.xml --quiet --resume --frames 0:2)
expect("a longer run cannot go on any more" EXISTS "${WORK}/smooth.checkpoint")
file(SIZE "${WORK}/smooth.0001.exr" size)
math(EXPR size "${size} - 1")
execute_process(COMMAND head -c ${size} "${WORK}/smooth.0001.exr" OUTPUT_FILE "${WORK}/cut.exr")
file(RENAME "${WORK}/cut.exr" "${WORK}/smooth.0001.exr")
quell(2 "which leaves none of the frames 0:2 to be made" run smooth.xml --quiet --resume --frames 0:2)
quell(0 "smooth.0001.exr is not there, or not whole, and not made again" run smooth.xml --quiet --resume)
foreach (frame 0 2 3 4)
  same(smooth.000${frame}.exr whole/smooth.000${frame}.exr)
endforeach ()

# What a scene refers to is one of its files.
file(WRITE "${WORK}/scene/a.obj" "mtllib a.mtl\nv -1 -1 -3\nv 1 -1 -3\nv 0 1 -3\nusemtl m\nf 1 2 3\n")
file(WRITE "${WORK}/scene/a.mtl" "newmtl m\nKe 1 2 3\n")
file(WRITE "${WORK}/traced.xml" [=[<pipeline version="1">
  <time count="5"/>
  <node id="pt" type="PathTraceSource">
    <property name="Scene" value="scene/a.obj"/><property name="Width" value="8"/><property name="Height" value="8"/>
  </node>
  <node id="taa" type="TemporalAntialias">
    <input port="radiance" from="pt:radiance"/>
    <input port="history" from="taa:radiance" delay="1"/>
  </node>
  <node id="in" type="ImageReader"><property name="File" value="in/noise.####.exr"/></node>
  <output name="o" from="taa:radiance" file="traced.####.exr"/>
  <output name="cut" from="in:radiance" file="cut.####.exr"/>
</pipeline>]=])
file(RENAME "${WORK}/in/noise.0003.exr" "${WORK}/kept.exr")
quell(1 "--resume goes on after frame 2" run traced.xml --quiet)
file(RENAME "${WORK}/kept.exr" "${WORK}/in/noise.0003.exr")
file(WRITE "${WORK}/scene/a.mtl" "newmtl m\nKe 1 2 2\n")
quell(2 "node \"pt\": the contents of all its files was" run traced.xml --quiet --resume)
file(WRITE "${WORK}/scene/a.mtl" "newmtl m\nKe 1 2 3\n")
quell(0 "going on after frame 2" run traced.xml --quiet --resume)

# Somebody's file under the checkpoint's name stays; a pipe is not opened.
foreach (name plain smooth)
  file(WRITE "${WORK}/mine/${name}.checkpoint" "mine")
  quell(0 "wrote 5 frames" run ${name}.xml --quiet --out mine)
  file(READ "${WORK}/mine/${name}.checkpoint" text)
  expect("somebody's file was written over: ${text}" text STREQUAL "mine")
endforeach ()
expect("not told: ${said}" said MATCHES "smooth.checkpoint: what is there is no checkpoint, and is not written over")
quell(2 "smooth.checkpoint: not a checkpoint" run smooth.xml --quiet --out mine --resume)
file(MAKE_DIRECTORY "${WORK}/pipe")
execute_process(COMMAND mkfifo "${WORK}/pipe/smooth.checkpoint")
quell(2 "smooth.checkpoint: cannot be opened for reading" run smooth.xml --quiet --out pipe --resume)

# A name that no file can have is a mistake of the pipeline.
string(REPEAT "x" 252 long)
file(READ "${WORK}/plain.xml" text)
string(REPLACE "plain.####" "${long}" text "${text}")
file(WRITE "${WORK}/long.xml" "${text}")
quell(2 "a name of 256 bytes, more than the 255 that a file's may have" check long.xml)
string(REPLACE "${long}" "y" text "${text}")
string(SUBSTRING "${long}" 0 250 long)
file(WRITE "${WORK}/long.xml" "${text}")
quell(0 "wrote" run long.xml --quiet --output "o=${long}.exr" --frames 0)
expect("a long name was not written" EXISTS "${WORK}/${long}.exr")

# Outputs over what is read, spelled differently; statistics over an input.
file(READ "${WORK}/plain.xml" text)
string(REPLACE "plain.####" "in/noise.0###" other "${text}")
file(WRITE "${WORK}/over.xml" "${other}")
quell(2 "output \"o\" would write over in/noise.####.exr, which node \"in\" reads" run over.xml --quiet)
string(REPLACE "in/noise.####.exr" "plain.0000.exr" other "${text}")
string(REPLACE "plain.####.exr" "new.exr" other "${other}")
file(WRITE "${WORK}/stats.xml" "${other}")
quell(2 "would write over plain.0000.exr, which node \"in\" reads" run stats.xml --quiet --stats plain.0000.exr)
quell(2 "would write over in/noise.####.exr, which node \"in\" reads" run plain.xml --quiet --frames 0 --stats in/noise.0003.exr)
quell(2 "would write over plain.####.exr, output \"o\" of this run" run plain.xml --quiet --frames 0 --stats plain.0000.exr)
quell(2 "what is there are no costs" calibrate plain.xml --repeats 1 --out plain.xml)
