# SPDX-License-Identifier: Apache-2.0
# Read by ctest. Registers each GoogleTest suite of `program` as test `folder`.SUITE, which runs in one process. Suites
# without a label are fast, and twelve of them share a process, `folder`.fast_NUMBER: most take less time than a process
# takes to start. Damaged files have a process of their own, since libraries crash on some (HDF5).
#   medium, slow   suites with these labels
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
function(refield_add_suites name label cost suites)
  list(TRANSFORM suites APPEND ".*")
  list(JOIN suites ":" filter)
  add_test(${folder}.${name} "${program}" "--gtest_filter=${filter}" --gtest_print_time=1)
  # Half an hour: with the thread sanitizer the longest suite takes 10 to 20 minutes, more than 15 on a slow machine.
  # A test that is skipped as a whole counts as skipped; of others ./dev names what was skipped.
  set_tests_properties(${folder}.${name} PROPERTIES
    LABELS ${label} COST ${cost} TIMEOUT 1800 ENVIRONMENT REFIELD_CACHE=off
    SKIP_REGULAR_EXPRESSION "PASSED  \\] 0 tests\\.\n\\[  SKIPPED \\] [0-9]+ tests?, listed below:\n(\\[  SKIPPED \\][^\n]*\n?)+$")
endfunction()

set(fast)
set(bundles 0)
foreach(suite IN LISTS suites)
  string(REGEX REPLACE "^\n(.*)\\.$" "\\1" suite "${suite}")
  list(REMOVE_ITEM unknown "${suite}")
  if(slow STREQUAL ALL OR suite IN_LIST slow)
    refield_add_suites(${suite} slow 100 ${suite})
  elseif(suite IN_LIST medium)
    refield_add_suites(${suite} medium 10 ${suite})
  elseif(suite MATCHES Damaged)
    refield_add_suites(${suite} fast 1 ${suite})
  else()
    list(APPEND fast ${suite})
  endif()
  list(LENGTH fast count)
  if(count EQUAL 12)
    math(EXPR bundles "${bundles} + 1")
    refield_add_suites(fast_${bundles} fast 5 "${fast}")
    set(fast)
  endif()
endforeach()
if(fast)
  math(EXPR bundles "${bundles} + 1")
  refield_add_suites(fast_${bundles} fast 5 "${fast}")
endif()
# MEDIUM and SLOW in the CMakeLists.txt of the folder name suites that do not exist: a test that fails says which.
foreach(suite IN LISTS unknown)
  add_test("${folder}.${suite}_is_no_suite_but_labelled" false)
endforeach()
