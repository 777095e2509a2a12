#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# ccache.sh CCACHE COMPILER ARGUMENTS...: through the cache. Beside a precompiled header goes its checksum, which ccache reads
# with CCACHE_PCH_EXTSUM for each file that includes it: the header itself takes half a second. One that is there already is
# removed first, or ccache would take it for an input of its own successor.
for argument; do
  case $argument in
    *.gch) rm -f "$argument" "$argument.sum" ;;
  esac
done
"$@" || exit
for argument; do
  case $argument in
    *.gch) [ -f "$argument" ] && sha256sum < "$argument" > "$argument.sum" ;;
  esac
done
exit 0
