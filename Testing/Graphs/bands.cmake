# cmake -DPROGRAM=quell -DSCENE=file.gltf -DPIPELINE=denoise-file.xml -DWORK=dir -P bands.cmake
# A frame made in bands of rows (--memory) is the frame made at once, to the last bit of its files; what goes wrong in a later
# band leaves nothing behind; what needs whole frames is refused.
include("${CMAKE_CURRENT_LIST_DIR}/program.cmake")
# Every bit of every layer, made again at once; the headers hold times.
function (same file)
  if (file MATCHES "[.]exr$")
    quell(0 "is what its pipeline makes" verify "${WORK}/bands/${file}" --quiet)
  else ()
    execute_process(COMMAND "${CMAKE_COMMAND}" -E compare_files "${WORK}/whole/${file}" "${WORK}/bands/${file}" RESULT_VARIABLE differ)
    if (differ)
      message(FATAL_ERROR "whole/${file} and bands/${file} differ")
    endif ()
  endif ()
endfunction ()

file(WRITE "${WORK}/noisy.xml" "<pipeline version=\"1\">
  <node id=\"pt\" type=\"PathTraceSource\">
    <property name=\"Scene\" value=\"${SCENE}\"/>
    <property name=\"Width\" value=\"80\"/>
    <property name=\"Height\" value=\"333\"/>
    <property name=\"SamplesPerPixel\" value=\"2\"/>
  </node>
  <output name=\"noisy\" from=\"pt:radiance\" file=\"noisy.exr\">
    <layer from=\"pt:albedo\"/><layer from=\"pt:normal\"/><layer from=\"pt:depth\"/>
  </output>
  <output name=\"shown\" from=\"pt:radiance\" file=\"noisy.png\" view=\"ACES-like\"/>
</pipeline>
")
# A source that makes its pixels, files of two kinds.
quell(0 "wrote whole/noisy.exr" run noisy.xml --out whole)
quell(0 "in 4 bands of 96 rows, one at a time: 171.9 MB of memory, 405.8 kB of it arrays, 1 % more pixels to make" run noisy.xml --out bands --memory 172)
same(noisy.exr)
same(noisy.png)
quell(0 "in 4 bands of 96 rows" explain noisy.xml --memory 172)

# Files in, filters with wide halos, files out; a part of the frame too.
file(COPY "${WORK}/whole/noisy.exr" DESTINATION "${WORK}")
# Every thread has scratch of its own: the budget is 3 MB, of the arrays, below what this machine needs.
quell(0 "memory: about" explain "${PIPELINE}" -D input=${WORK}/noisy.exr)
string(REGEX MATCH "memory: about ([0-9]+)[.]([0-9]) MB, scenes not counted: [45][.]" told "${said}")
expect("no memory told: ${said}" told)
math(EXPR budget "${CMAKE_MATCH_1}${CMAKE_MATCH_2} - 30")
string(REGEX REPLACE "(.)$" ".\\1" budget "${budget}")
foreach (region "" "--region;5,40,77,301")
  quell(0 "wrote" run "${PIPELINE}" -D input=${WORK}/noisy.exr ${region} --out whole)
  # What a stage tells of a frame is of the whole frame, each pixel counted once.
  string(REGEX MATCH "fireflies: clamped [^\n]*" told "${said}")
  quell(0 "${told}" run "${PIPELINE}" -D input=${WORK}/noisy.exr ${region} --out bands --memory ${budget})
  expect("nothing told of fireflies, or no bands: ${said}" told AND said MATCHES "bands of")
  same(out/denoised.0000.exr)
  same(out/denoised.png)
endforeach ()

# A file cut off: the rows above are good, and nothing of them stays.
file(SIZE "${WORK}/noisy.exr" bytes)
math(EXPR bytes "${bytes} * 3 / 4")
execute_process(COMMAND head -c ${bytes} "${WORK}/noisy.exr" OUTPUT_FILE "${WORK}/cut.exr")
quell(1 "cut.exr" run "${PIPELINE}" -D input=${WORK}/cut.exr --out cut --memory ${budget})
file(GLOB_RECURSE left "${WORK}/cut/*" "${WORK}/cut/out/.*.part")
if (left)
  message(FATAL_ERROR "left behind: ${left}")
endif ()

quell(2 "and bands of 16 rows still need" run noisy.xml --memory 0.01)
get_filename_component(pipelines "${PIPELINE}" DIRECTORY)
quell(2 "through a delayed input, which needs the whole frame" run "${pipelines}/svgf.xml" -D width=64 -D height=36 --memory 0.2)
