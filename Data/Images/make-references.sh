#!/usr/bin/env bash
# Makes the references again (a few minutes): Data/Images/make-references.sh
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
quell=${QUELL:-$here/../../build/bin/quell}
cd "$here"
"$quell" run reference.xml --frames 31:32
"$quell" run noisy.xml
