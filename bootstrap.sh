#!/usr/bin/env bash
# From a bare Debian 12 to a running Quell: installs what is missing, configures, builds, then does what you ask.
#   ./bootstrap.sh run FILE.xml [options]   path-trace, filter and write what the pipeline says (quell run)
#   ./bootstrap.sh test [ctest options]     build everything and run the whole test suite
#   ./bootstrap.sh build                    build everything
#   ./bootstrap.sh view [FILE]              assemble, steer and inspect a pipeline in a window (quell-view)
#   ./bootstrap.sh bench [NAME...]          measure (all, or those whose names begin so); build/bench.json
#   ./bootstrap.sh report filters           bias and variance of every filter over many seeds; Documentation/filters.md
#   ./bootstrap.sh report tradeoff          what the default pipelines cost and buy; Documentation/tradeoff-pipelines.md
#   ./bootstrap.sh report frames [FOLDER]   shipped pipelines on frames with references; Documentation/frames.md
#   ./bootstrap.sh report numerics          float against double, storage, extremes; Documentation/numerics.md
set -euo pipefail
top=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=${QUELL_BUILD_DIR:-$top/build}

packages=(g++ cmake ninja-build ccache
  libvtk9-dev libembree-dev libopenimageio-dev openimageio-tools libopencolorio-dev libtbb-dev libhwy-dev libexpat1-dev
  libtinyobjloader-dev libcli11-dev nlohmann-json3-dev libgtest-dev libxml2-dev
  libimgui-dev libx11-dev pkg-config fonts-dejavu-core xvfb xauth)

say() { printf 'bootstrap: %s\n' "$*" >&2; }
usage() { sed -n '3,11s/^# *//p' "${BASH_SOURCE[0]}" >&2; exit 2; }

install_missing() {
  local missing=() p
  for p in "${packages[@]}"; do
    [ "$(dpkg-query -W -f '${db:Status-Status}' "$p" 2>/dev/null || true)" = installed ] || missing+=("$p")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  local root=()
  if [ "$(id -u)" != 0 ]; then
    command -v sudo >/dev/null || { say "as root, install: apt-get install ${missing[*]}"; exit 1; }
    root=(sudo)
  fi
  say "installing ${#missing[@]} packages: ${missing[*]}"
  local log
  log=$(mktemp)
  if ! { "${root[@]}" apt-get update -q && "${root[@]}" env DEBIAN_FRONTEND=noninteractive \
         apt-get install -y -q --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
    tail -n 20 "$log" >&2
    say "installation failed; the whole log is in $log"
    exit 1
  fi
  rm -f "$log"
}

configure() {
  [ -f "$build/build.ninja" ] && return 0
  say "configuring in $build"
  mkdir -p "$build"
  cmake -G Ninja -S "$top" -B "$build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER_LAUNCHER=ccache \
    >"$build/configure.log" 2>&1 || { tail -n 30 "$build/configure.log" >&2; exit 1; }
}

# Quiet when there is nothing to say; the compiler's own words when something fails.
compile() {
  say "building ${*:-everything} (log: $build/build.log)"
  cmake --build "$build" ${*:+--target "$@"} >"$build/build.log" 2>&1 || { tail -n 40 "$build/build.log" >&2; exit 1; }
}

[ $# -ge 1 ] || usage
command=$1
shift
case $command in
  run)
    [ $# -ge 1 ] || usage
    install_missing; configure; compile quell
    exec "$build/bin/quell" run "$@" ;;
  build)
    install_missing; configure; compile ;;
  test)
    install_missing; configure; compile
    cd "$build" && exec ctest --output-on-failure -j "$(nproc)" "$@" ;;
  view)
    install_missing; configure; compile quell-view
    exec "$build/bin/quell-view" "$@" ;;
  bench)
    packages+=(libopencv-dev libopencv-contrib-dev) # only to compare with
    install_missing; configure
    cmake -B "$build" -DQUELL_BENCHMARKS=ON >"$build/configure.log" 2>&1 || { tail -n 30 "$build/configure.log" >&2; exit 1; }
    compile quell-bench
    exec "$build/bin/quell-bench" --json "$build/bench.json" "$@" ;;
  report)
    [ $# -ge 1 ] || usage
    what=$1
    shift
    case $what in
      filters)
        install_missing; configure; compile quell-filter-report
        exec "$build/bin/quell-filter-report" "$top" "$@" ;;
      tradeoff)
        install_missing; configure; compile quell
        exec "$top/Testing/TradeoffReport/tradeoff-report.sh" "$build/bin/quell" "$top" ;;
      frames)
        install_missing; configure; compile quell
        exec "$top/Testing/FilterStudy/frames.sh" "$top" "$build/bin/quell" "${1:-$top/../shared/data}" ;;
      numerics)
        install_missing; configure; compile quell-numerics-report
        exec "$build/bin/quell-numerics-report" "$top" "$@" ;;
      *) usage ;;
    esac ;;
  *)
    say "unknown command \"$command\""; usage ;;
esac
