# SPDX-License-Identifier: Apache-2.0
# Read by ctest. Registers each GoogleTest suite of `program` as test `folder`.SUITE, which runs in one process.
#   medium, slow   suites with these labels; all others have label fast
# Suites that take long start first, so that none of them runs alone at the end.
cmake_policy(VERSION 3.25)
if(NOT EXISTS "${program}")
  add_test(${folder}.not_built "${program}")
  if(slow STREQUAL ALL)
    set_tests_properties(${folder}.not_built PROPERTIES LABELS slow)
  endif()
  return()
endif()
execute_process(COMMAND "${program}" --gtest_list_tests OUTPUT_VARIABLE listing RESULT_VARIABLE status)
if(NOT status EQUAL 0)
  message(FATAL_ERROR "${program} cannot list its tests: ${status}")
endif()
set(unknown ${medium} ${slow})
list(REMOVE_ITEM unknown ALL)
# Suites stand at the beginning of a line and end in a dot; their tests are indented.
string(REGEX MATCHALL "\n[A-Za-z][A-Za-z0-9_/]*\\." suites "\n${listing}")
foreach(suite IN LISTS suites)
  string(REGEX REPLACE "^\n(.*)\\.$" "\\1" suite "${suite}")
  list(REMOVE_ITEM unknown "${suite}")
  set(label fast)
  set(cost 1)
  if(slow STREQUAL ALL OR suite IN_LIST slow)
    set(label slow)
    set(cost 100)
  elseif(suite IN_LIST medium)
    set(label medium)
    set(cost 10)
  endif()
  add_test(${folder}.${suite} "${program}" "--gtest_filter=${suite}.*" --gtest_print_time=1)
  # A suite that is skipped as a whole counts as skipped; of others ./dev names the tests that were skipped.
  set_tests_properties(${folder}.${suite} PROPERTIES
    LABELS ${label} COST ${cost} TIMEOUT 900 ENVIRONMENT REFIELD_CACHE=off
    SKIP_REGULAR_EXPRESSION "PASSED  \\] 0 tests\\.\n\\[  SKIPPED \\] [0-9]+ tests?, listed below:\n(\\[  SKIPPED \\][^\n]*\n?)+$")
endforeach()
# MEDIUM and SLOW in the CMakeLists.txt of the folder name suites that do not exist: a test that fails says which.
foreach(suite IN LISTS unknown)
  add_test("${folder}.${suite}_is_no_suite_but_labelled" false)
endforeach()
