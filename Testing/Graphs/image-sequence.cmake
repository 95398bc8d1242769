# cmake -DPROGRAM=quell -DSCENE=... -DWORK=dir -P image-sequence.cmake
# Image sequences as input: numbers that do not begin at 0, negative ones, numbers that are missing.
include("${CMAKE_CURRENT_LIST_DIR}/program.cmake")

file(WRITE "${WORK}/noise.xml" [=[<pipeline version="1">
  <variable name="scene" type="path" default="none"/> <variable name="first" type="int" default="0"/>
  <time first="$(first)" count="4" rate="8"/>
  <node id="pt" type="PathTraceSource">
    <property name="Scene" value="$(scene)"/>
    <property name="Width" value="24"/>
    <property name="Height" value="16"/>
  </node>
  <output name="o" from="pt:radiance" file="in/noise.####.exr"><layer from="pt:motion"/></output>
</pipeline>]=])
file(WRITE "${WORK}/smooth.xml" [=[<pipeline version="1">
  <variable name="first" type="int" default="0"/> <variable name="count" type="int" default="4"/>
  <time first="$(first)" count="$(count)" rate="8"/>
  <node id="in" type="ImageReader"><property name="File" value="in/noise.####.exr"/></node>
  <node id="taa" type="TemporalAntialias">
    <input port="radiance" from="in:radiance"/>
    <input port="motion" from="in:motion"/>
    <input port="history" from="taa:radiance" delay="1"/>
  </node>
  <output name="o" from="taa:radiance" file="smooth.####.exr"/>
</pipeline>]=])

# Four frames from -2 on, and four from 7 on.
quell(0 "wrote 4 frames" run noise.xml -D scene=${SCENE} -D first=-2 --quiet)
quell(0 "wrote 4 frames" run noise.xml -D scene=${SCENE} -D first=7 --quiet)
foreach (frame -002 -001 0000 0001 0007 0010)
  expect("no frame ${frame}" EXISTS "${WORK}/in/noise.${frame}.exr")
endforeach ()
quell(0 "wrote 4 frames" run smooth.xml -D first=-2 --quiet --out negative)
expect("no frame -2" EXISTS "${WORK}/negative/smooth.-002.exr")
quell(0 "1 frame before is computed" run smooth.xml -D first=-2 --frames=-1:0 --quiet --out middle)
same(middle/smooth.0000.exr negative/smooth.0000.exr)
same(middle/smooth.-001.exr negative/smooth.-001.exr)
quell(0 "every bit" verify negative/smooth.-001.exr --quiet)
quell(0 "wrote 4 frames" run smooth.xml -D first=7 --quiet --out late)
# A sequence that begins elsewhere, and one with a hole: the frame, and what there is instead.
quell(1 "frame 2 of \"in/noise.####.exr\" is missing: there is no \"in/noise.0002.exr\"; the sequence has frames -2:1, 7:10" run smooth.xml --quiet --out hole)
expect("the frames before the hole" EXISTS "${WORK}/hole/smooth.0001.exr")
expect("a frame after the hole" NOT EXISTS "${WORK}/hole/smooth.0003.exr")
# The hole filled, the run goes on where it was.
file(COPY_FILE "${WORK}/in/noise.0007.exr" "${WORK}/in/noise.0002.exr")
file(COPY_FILE "${WORK}/in/noise.0008.exr" "${WORK}/in/noise.0003.exr")
quell(0 "going on after frame 1" run smooth.xml --quiet --out hole --resume)
quell(0 "wrote 4 frames" run smooth.xml --quiet --out whole)
same(hole/smooth.0003.exr whole/smooth.0003.exr)
# Without history a run may begin behind a hole, and where the first frame of the timeline is missing.
file(REMOVE "${WORK}/in/noise.-002.exr" "${WORK}/in/noise.0000.exr")
file(WRITE "${WORK}/plain.xml" [=[<pipeline version="1">
  <time first="-2" count="4"/>
  <node id="in" type="ImageReader"><property name="File" value="in/noise.####.exr"/></node>
  <output name="o" from="in:radiance" file="plain.####.exr"/>
</pipeline>]=])
quell(0 "wrote plain.0001.exr" run plain.xml --frames 1 --quiet)
same(plain.0001.exr in/noise.0001.exr)
quell(1 "the sequence has frames -1, 1:3, 7:10" run plain.xml --quiet)
