#!/usr/bin/env bash
# tradeoff-report.sh QUELL TOP: measures the project's own default pipelines on this machine and writes
# TOP/Documentation/tradeoff-pipelines.md with the pages behind it in TOP/Documentation/tradeoff/.
# About eight minutes on two cores; interrupted, it goes on where it was when it is called again.
set -euo pipefail
quell=$1 top=$2
pipelines=$top/Data/Pipelines
work=${TMPDIR:-/tmp}/quell-tradeoff-report
pages=$top/Documentation/tradeoff
mkdir -p "$work" "$pages"
cd "$work"

say() { printf 'tradeoff-report: %s\n' "$*" >&2; }

# sweep NAME TITLE PIPELINE OPTIONS...: the sweep, its page, and what it printed as a section.
sweep() {
  local name=$1 title=$2 pipeline=$3
  shift 3
  say "$name"
  "$quell" tradeoff "$pipelines/$pipeline" "$@" --out "$work/$name" > "$name.txt"
  cp "$name/report.html" "$pages/$name.html"
  {
    printf '\n## %s\n\n' "$title"
    printf '```\nquell tradeoff Data/Pipelines/%s' "$pipeline"
    printf ' %q' "$@" | sed 's|\\,|,|g; s|'"$top"'/||g; s|'"$work"'/||g'
    printf '\n```\n\n[The page with plots, pictures and every setting](tradeoff/%s.html). What the command printed:\n\n```\n' "$name"
    sed "s|$work/||g; s|$top/||g" "$name.txt"
    printf '```\n'
  } >> "$work/sections.md"
}

[ -f quick-reference.exr ] ||
  "$quell" run "$pipelines/quick.xml" -D spp=4096 -D seed=1000 --output pt:radiance=quick-reference.exr --out "$work" --quiet >/dev/null
: > sections.md
sweep svgf 'svgf.xml: samples, passes over indirect light, anti-aliasing' svgf.xml \
  --reference "$top/Data/Images/cornell-box-moving.0031.exr" --vary spp=1,2,4 --vary indirect/atrous.Iterations=2,4,5 \
  --vary taa=on,off --seeds 3 --repeats 3 --no-ledger
sweep quick 'quick.xml: samples against the width of a bilateral filter' quick.xml \
  --reference "$work/quick-reference.exr" --vary 'spp=1..64*4' --vary blur.Radius=2,4,8 --vary blur=on,off --seeds 4 --repeats 4
{
  printf '# What the default pipelines cost and buy\n\n'
  printf 'Written by `./bootstrap.sh report tradeoff` ([how it measures](tradeoff.md)). Times are of the machine named on the pages and of that\n'
  printf 'hour; compare settings with each other, not with another machine. relMSE decides; errors are means over seeds.\n'
  cat sections.md
} > "$top/Documentation/tradeoff-pipelines.md"
say "wrote Documentation/tradeoff-pipelines.md"
