// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>
#include <type_traits>
#include <utility>

#include "refield/field.h"

/// What the parts of the Python module share: long calls, and images between NumPy and the library.
namespace refield::python {

namespace py = pybind11;

using Floats = py::array_t<float, 0>;  ///< float32 of any strides; nothing is converted

/// Throws Error in a process that was forked from one whose threads had already been started: they do not
/// exist in the child. Called by everything that works on several threads.
void require_own_threads();

/// A short call, in this thread, without the interpreter's lock.
template <class Work>
auto unlocked(const Work& work) {
  require_own_threads();
  const py::gil_scoped_release without_lock;
  return work();
}

/// A message of the library with the names of Python's arguments in place of the command line's options.
std::string in_python(const std::string& message);

/// Passes findings of the library on to Python's logger "refield".
void log_note(const std::string& text);

/// A long call. `work` runs in a thread of its own and without the interpreter's lock; meanwhile this thread
/// passes progress on to `progress` (a callable of stage, done, total, or None), and looks for signals twenty
/// times per second, as only Python's main thread may. An exception of either, such as KeyboardInterrupt,
/// stops the work and is thrown once it has stopped.
class LongCall {
 public:
  LongCall(py::object progress, std::optional<int> threads);

  template <class Work>
  auto operator()(Work&& work) -> std::invoke_result_t<Work, const RunContext&> {
    using Result = std::invoke_result_t<Work, const RunContext&>;
    if constexpr (std::is_void_v<Result>) {
      run([&] { work(context_); });
    } else {
      std::optional<Result> result;
      run([&] { result.emplace(work(context_)); });
      return *std::move(result);
    }
  }

 private:
  void run(const std::function<void()>& work);
  void report(std::deque<StageProgress> stages, std::deque<std::string> notes);

  py::object progress_;
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<StageProgress> stages_;
  std::deque<std::string> notes_;
  bool is_done_ = false;
  RunContext context_;
};

/// An array of its own from an image or a map, whose values it takes over: [height × width × channels], or
/// [height × width] of one channel.
py::array array_of(Image&& image);
py::array array_of(std::vector<float>&& values, std::vector<py::ssize_t> shape);

/// A view of [height × width × 3] floats; `name` for messages. Throws InputError for another shape.
ImageView view_of(const Floats& array, const std::string& name);
/// The same of each image of [images × height × width × 3].
std::vector<ImageView> views_of(const Floats& array, const std::string& name);
/// Pixels that count; empty for None. Throws InputError unless it is of [height × width].
using Flags = py::array_t<bool, py::array::c_style | py::array::forcecast>;
Mask mask_of(const std::optional<Flags>& mask, const std::vector<ImageView>& images);

/// [height × width] of a map that is not empty, else None.
py::object map_or_none(Image&& map);

/// The values of an array that results are written to: float32 of this shape, without gaps, aligned,
/// writable. Throws InputError.
float* target_of(py::array& out, const std::vector<py::ssize_t>& shape);

void bind_field(py::module_& module);
void bind_scenes(py::module_& module);

}  // namespace refield::python
