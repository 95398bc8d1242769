#!/usr/bin/env bash
# Makes the baselines of baselines.cmake again with build/bin/quell, after showing how far each moved.
#   Testing/Graphs/update-baselines.sh [name]
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
top=$(cd "$here/../.." && pwd)
quell=${QUELL:-$top/build/bin/quell}
mkdir -p "$here/Baseline"
sed -n 's/^quell_baseline_test(\(.*\))$/\1/p' "$here/baselines.cmake" | while read -r name _ pipeline _ output _ max _ args; do
  [ $# -eq 0 ] || [ "$1" = "$name" ] || continue
  work=$(mktemp -d)
  # shellcheck disable=SC2086
  (cd "$work" && "$quell" run "$top/Data/Pipelines/$pipeline" --quiet $args)
  if [ -f "$here/Baseline/$name.exr" ]; then
    "$quell" compare "$work/$output" "$here/Baseline/$name.exr" --metric relMSE || true
  fi
  cp "$work/$output" "$here/Baseline/$name.exr"
  rm -rf "$work"
  echo "$name: Testing/Graphs/Baseline/$name.exr (allowed relMSE $max)"
done
