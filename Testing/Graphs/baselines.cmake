# name, pipeline, the file compared, the arguments. update-baselines.sh reads the same lines.
quell_baseline_test(quick PIPELINE quick.xml OUTPUT out/quick.exr MAX 1e-4 ARGS -D width=64 -D height=64 -D spp=4)
quell_baseline_test(svgf PIPELINE svgf.xml OUTPUT out/svgf.0007.exr MAX 1e-3 ARGS -D width=64 -D height=64 -D frames=8)
quell_baseline_test(gallery PIPELINE aov.xml OUTPUT out/aov.0000.exr MAX 1e-3 ARGS -D width=48 -D height=36 -D spp=4)
