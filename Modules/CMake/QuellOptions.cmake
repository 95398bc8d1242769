# Flags of all our own code, in one place.
# -ffp-contract=off: GCC otherwise fuses multiply-adds differently in different inlining contexts, and the same pixel
# would differ in its last bit between tilings. Fused operations are written where they are meant.
set(quell_compile_options
  -Wall -Wextra -Wshadow -Woverloaded-virtual -Wno-unused-parameter
  -ffp-contract=off -fno-math-errno -fno-trapping-math -fvisibility-inlines-hidden)
if (QUELL_STRICT)
  list(APPEND quell_compile_options -Werror)
endif ()
# -g1: lines for the reports are all that is wanted, at a third of the disk.
if (QUELL_SANITIZER)
  add_compile_options(-fsanitize=${QUELL_SANITIZER} -fno-omit-frame-pointer -g1)
  add_link_options(-fsanitize=${QUELL_SANITIZER})
  if (QUELL_SANITIZER MATCHES "undefined")
    add_compile_options(-fno-sanitize-recover=undefined)
  endif ()
endif ()
