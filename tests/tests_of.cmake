# Writes what ctest is to run of an executable of GoogleTest: each suite is a test, a process for all
# of its cases, but for SEPARATE_SUITES, of which each case is one. These begin before the others, and
# LONG_SUITES before them.
# Usage: cmake -D EXECUTABLE=... -D FOLDER=... -D SEPARATE_SUITES=... -D LONG_SUITES=... -D OUTPUT=...
#          -P tests_of.cmake
cmake_minimum_required(VERSION 3.25)

execute_process(COMMAND ${EXECUTABLE} --gtest_list_tests
  OUTPUT_VARIABLE listed TIMEOUT 120 COMMAND_ERROR_IS_FATAL ANY)
# Comments tell values of parameters, which may have any character.
string(REGEX REPLACE " *#[^\n]*" "" listed "${listed}")
string(REPLACE "\n" ";" lines "${listed}")

set(script "")
set(suites)
# `part`: a suite, or one of its cases; the properties of its test follow.
function(add part)
  list(JOIN ARGN " " properties)
  string(APPEND script "add_test(\"${FOLDER}/${part}\" \"${EXECUTABLE}\" \"--gtest_filter=${filter}\")\n"
    "set_tests_properties(\"${FOLDER}/${part}\" PROPERTIES TIMEOUT 600 LABELS ${FOLDER} ${properties})\n")
  set(script "${script}" PARENT_SCOPE)
endfunction()

foreach(line IN LISTS lines)
  if(line MATCHES "^([A-Za-z0-9_/]+)\\.$")
    set(suite ${CMAKE_MATCH_1})
    list(APPEND suites ${suite})
    if(NOT suite IN_LIST SEPARATE_SUITES)
      set(filter "${suite}.*")
      set(cost 0)
      if(suite IN_LIST LONG_SUITES)
        set(cost 20)
      endif()
      # A suite of which a case is skipped has still run, and may have failed.
      add(${suite} COST ${cost} FAIL_REGULAR_EXPRESSION "\"Running 0 tests\"")
    endif()
  elseif(line MATCHES "^  ([A-Za-z0-9_/]+)$" AND suite IN_LIST SEPARATE_SUITES)
    set(filter "${suite}.${CMAKE_MATCH_1}")
    add(${filter} COST 10 SKIP_REGULAR_EXPRESSION [["\\[  SKIPPED \\]"]])
  elseif(NOT line MATCHES "^(Running .*|  [A-Za-z0-9_/]+|)$")
    message(FATAL_ERROR "${EXECUTABLE} lists '${line}', which is neither a suite nor a case")
  endif()
endforeach()
foreach(suite IN LISTS SEPARATE_SUITES LONG_SUITES)
  if(NOT suite IN_LIST suites)
    message(FATAL_ERROR "${EXECUTABLE} has no suite '${suite}'")
  endif()
endforeach()
file(WRITE ${OUTPUT} "${script}")
