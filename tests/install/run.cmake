# SPDX-License-Identifier: BSD-3-Clause
# What the install tests share: run(COMMAND...) stops with what the command said if it fails, and leaves its output in
# `output`, what it said on stderr in `error`.
function(run)
  execute_process(COMMAND ${ARGV} OUTPUT_VARIABLE output ERROR_VARIABLE error RESULT_VARIABLE code)
  if(code)
    list(JOIN ARGV " " command)
    message(FATAL_ERROR "${command}\n${output}\n${error}")
  endif()
  set(output "${output}" PARENT_SCOPE)
  set(error "${error}" PARENT_SCOPE)
endfunction()
