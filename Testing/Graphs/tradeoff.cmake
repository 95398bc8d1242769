# cmake -DPROGRAM=quell -DPIPELINE=quick.xml -DWORK=dir -P tradeoff.cmake
# The sweep of Documentation/tradeoff.md, small: it ends, its report names the right winner, and what it chose runs.
include("${CMAKE_CURRENT_LIST_DIR}/program.cmake")

set(small -D width=48 -D height=48)
quell(0 "ref.exr" run "${PIPELINE}" ${small} -D spp=256 -D seed=100 --output pt:radiance=ref.exr --quiet)
set(sweep tradeoff "${PIPELINE}" ${small} --reference ref.exr --vary spp=1,4 --vary blur.Radius=2,4 --vary blur=on,off --metric relMSE --seeds 2 --repeats 2 --quiet)
quell(0 "chosen: spp=4 blur.Radius=" ${sweep} --out sweep --budget 1000s)
foreach (file report.html tradeoff.csv tradeoff.json best.xml runs.jsonl)
  if (NOT EXISTS "${WORK}/sweep/${file}")
    message(FATAL_ERROR "no ${file}")
  endif ()
endforeach ()
file(READ "${WORK}/sweep/tradeoff.json" json)
string(JSON count LENGTH "${json}" settings)
string(JSON ledger LENGTH "${json}" ledger)
if (NOT count EQUAL 6 OR NOT ledger EQUAL 5)
  message(FATAL_ERROR "${count} settings, ${ledger} rows of the ledger")
endif ()
quell(0 "wrote out/quick.exr" run sweep/best.xml --quiet)
# All runs are there: nothing runs again, and other choices come from the same runs.
file(SHA256 "${WORK}/sweep/runs.jsonl" before)
quell(0 "chosen: spp=" ${sweep} --out sweep --target relMSE=1000)
quell(3 "no setting has relMSE <= 1e-09; the nearest is spp=4" ${sweep} --out sweep --target relMSE=1e-9 --no-ledger)
if (EXISTS "${WORK}/sweep/best.xml")
  message(FATAL_ERROR "the choice of an earlier command was left")
endif ()
quell(0 "Pareto set" ${sweep} --out sweep --no-ledger)
# A sweep that cannot begin leaves nothing that is in the way of the right one.
quell(2 "the reference ref.exr is 48 x 48 pixels, the output 32 x 48" ${sweep} -D width=32 --out begun)
# Another sweep does not go into the same directory.
quell(1 "holds another sweep" ${sweep} --out sweep --seed 5)
# Mistakes are told before anything runs.
quell(2 "did you mean \"Radius\"" tradeoff "${PIPELINE}" --reference ref.exr --vary blur.Radus=1 --out other)
quell(2 "there is no node" tradeoff "${PIPELINE}" --reference ref.exr --vary blurr=on,off --out other)
quell(2 "write milliseconds" tradeoff "${PIPELINE}" --reference ref.exr --budget soon --out other)
quell(2 "none.exr" tradeoff "${PIPELINE}" --reference none.exr --out other)
if (EXISTS "${WORK}/other")
  message(FATAL_ERROR "a refused sweep made its directory")
endif ()
# With history the last frame is measured: of a numbered reference no other frame needs to be there.
get_filename_component(temporal "${PIPELINE}" DIRECTORY)
set(temporal "${temporal}/svgf.xml" -D width=32 -D height=32 -D frames=3)
quell(0 "moving.0002.exr" run ${temporal} --frames 2:2 --output "pt:radiance=moving.####.exr" --quiet)
quell(0 "Pareto set" tradeoff ${temporal} --reference "moving.####.exr" --seeds 1 --repeats 1 --metric relMSE --no-ledger --quiet
  --out moving)
