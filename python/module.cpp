// SPDX-License-Identifier: Apache-2.0
// The extension module refield._refield: errors, long calls, arrays. python/refield/ is what users see.
#include <pthread.h>

#include <algorithm>
#include <cfenv>
#include <chrono>
#include <cstring>
#include <map>
#include <sstream>

#include "binding.h"

namespace refield::python {

namespace {

// Set once the library may have started threads; a forked child has none of them.
std::atomic<bool> has_started{false};
std::atomic<bool> lost_threads{false};

std::string text_of(const std::vector<py::ssize_t>& shape) {
  if (shape.empty()) return "of a single number";
  std::ostringstream text;
  for (std::size_t i = 0; i < shape.size(); ++i) text << (i == 0 ? "" : "×") << shape[i];
  return text.str();
}

std::string shape_of(const py::array& array) {
  return text_of({array.shape(), array.shape() + array.ndim()});
}

/// Strides of an array's last three axes, in floats.
ImageView view_at(const float* first, const py::array& array, int axis) {
  constexpr auto size = static_cast<py::ssize_t>(sizeof(float));
  return {first,
          static_cast<int>(array.shape(axis + 1)),
          static_cast<int>(array.shape(axis)),
          3,
          array.strides(axis + 2) / size,
          array.strides(axis + 1) / size,
          array.strides(axis) / size};
}

void require_images(const Floats& array, int axes, const std::string& name) {
  constexpr py::ssize_t max_side = 1 << 20;
  if (array.ndim() != axes || array.shape(axes - 1) != 3)
    throw InputError(name, ": has the shape ", shape_of(array), "; give ",
                     axes == 4 ? "images×height×width×3" : "height×width×3");
  for (int axis = axes - 3; axis < axes - 1; ++axis)
    if (array.shape(axis) < 1 || array.shape(axis) > max_side)
      throw InputError(name, ": has the shape ", shape_of(array), "; give images of at least one pixel");
  if (axes == 4 && array.shape(0) > max_side)
    throw InputError(name, ": has the shape ", shape_of(array), "; give at most ", max_side, " images");
  for (int axis = 0; axis < axes; ++axis)
    if (array.strides(axis) % static_cast<py::ssize_t>(sizeof(float)) != 0)
      throw InputError(name, ": its strides are not whole numbers of floats; give a copy");
}

/// Threads that work for calls from Python, kept for further calls: a thread that has worked with oneTBB and
/// ends may leave some kilobytes behind, for ever. They end with the process.
class Workers {
 public:
  /// Runs `work`, which must not throw, in a thread of its own.
  void start(std::function<void()> work) {
    const std::scoped_lock lock(mutex_);
    waiting_.push_back(std::move(work));
    if (idle_ >= waiting_.size())
      added_.notify_one();
    else
      std::thread([this] { serve(); }).detach();
  }

 private:
  [[noreturn]] void serve() {
    std::fesetenv(FE_DFL_ENV);  // not the caller's
    for (;;) {
      std::unique_lock lock(mutex_);
      ++idle_;
      added_.wait(lock, [&] { return !waiting_.empty(); });
      --idle_;
      const auto work = std::move(waiting_.front());
      waiting_.pop_front();
      lock.unlock();
      work();
    }
  }

  std::mutex mutex_;
  std::condition_variable added_;
  std::deque<std::function<void()>> waiting_;
  std::size_t idle_ = 0;
};

Workers& workers() {
  static Workers* const all = new Workers;  // outlives its threads
  return *all;
}

py::object new_exception(py::module_& module, const char* name, const py::object& bases, const char* text) {
  const std::string full = std::string("refield.") + name;
  auto type =
      py::reinterpret_steal<py::object>(PyErr_NewExceptionWithDoc(full.c_str(), text, bases.ptr(), nullptr));
  if (!type) throw py::error_already_set();
  module.attr(name) = type;
  return type;
}

// Types live as long as the interpreter.
PyObject *error_type, *input_error_type, *format_error_type, *device_error_type, *solver_error_type;

void bind_errors(py::module_& module) {
  const py::object error = new_exception(module, "Error", py::reinterpret_borrow<py::object>(PyExc_Exception),
                                         "Base of every error that refield expects. The text is that of the "
                                         "command line: file or argument, value, remedy.");
  const auto value_error = py::reinterpret_borrow<py::object>(PyExc_ValueError);
  const auto os_error = py::reinterpret_borrow<py::object>(PyExc_OSError);
  error_type = error.inc_ref().ptr();
  const auto add = [&](const char* name, const py::object& bases, const char* text) {
    return new_exception(module, name, bases, text).release().ptr();
  };
  input_error_type = add("InputError", py::make_tuple(error, value_error),
                         "An argument cannot be used: out of range, of another shape, too few images.");
  format_error_type = add("FormatError", py::make_tuple(error, value_error),
                          "A file breaks its format: truncated, of another kind or version.");
  device_error_type = add("DeviceError", py::make_tuple(error, os_error),
                          "The operating system refused: missing file, no space, no permission.");
  solver_error_type = add("SolverError", py::make_tuple(error), "A numerical method found no valid answer.");
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const InputError& caught) {
      PyErr_SetString(input_error_type, in_python(caught.what()).c_str());
    } catch (const FormatError& caught) {
      PyErr_SetString(format_error_type, in_python(caught.what()).c_str());
    } catch (const DeviceError& caught) {
      PyErr_SetString(device_error_type, in_python(caught.what()).c_str());
    } catch (const SolverError& caught) {
      PyErr_SetString(solver_error_type, in_python(caught.what()).c_str());
    } catch (const Error& caught) {
      PyErr_SetString(error_type, in_python(caught.what()).c_str());
    } catch (const Interrupted&) {
      PyErr_SetNone(PyExc_KeyboardInterrupt);
    }
  });
}

}  // namespace

void require_own_threads() {
  has_started = true;
  if (lost_threads)
    throw Error(
        "refield was used before this process was forked, and its threads do not exist here; start processes "
        "with multiprocessing's method 'spawn' or 'forkserver', or fork before the first use");
}

std::string in_python(const std::string& message) {
  // Those that differ by more than their dashes.
  static const std::map<std::string, std::string> names = {{"kernels", "max_kernels"},
                                                           {"hold-out", "Session.held_out"},
                                                           {"keep-outliers", "keep_outliers=True"},
                                                           {"full-scale-electrons", "full_scale_electrons"}};
  const auto is_of_name = [](char c) { return (c >= 'a' && c <= 'z') || c == '-'; };
  std::string text;
  for (std::size_t i = 0; i < message.size();) {
    const bool starts = message.compare(i, 2, "--") == 0 && (i == 0 || std::strchr(" '(;,", message[i - 1]));
    std::size_t end = i + 2;
    while (starts && end < message.size() && is_of_name(message[end])) ++end;
    if (!starts || end == i + 2) {
      text += message[i++];
      continue;
    }
    std::string name = message.substr(i + 2, end - i - 2);
    if (const auto other = names.find(name); other != names.end())
      name = other->second;
    else
      std::ranges::replace(name, '-', '_');
    text += name;
    i = end;
  }
  return text;
}

void log_note(const std::string& text) {
  py::module_::import("logging").attr("getLogger")("refield").attr("warning")("%s", in_python(text));
}

LongCall::LongCall(py::object progress, std::optional<int> threads) : progress_(std::move(progress)) {
  require_own_threads();
  if (threads && *threads < 0)
    throw InputError("threads is ", *threads, "; give 1 or more, or None for all cores");
  if (!progress_.is_none() && !PyCallable_Check(progress_.ptr()))
    throw InputError("progress is not callable; give a function of stage, done and total, or a tqdm bar");
  context_.stop = &stop_;
  context_.max_threads = threads.value_or(0);
  if (!progress_.is_none())
    context_.on_progress = [this](const StageProgress& stage) {
      const std::scoped_lock lock(mutex_);
      stages_.push_back(stage);
      changed_.notify_one();
    };
  context_.on_note = [this](const std::string& text) {
    const std::scoped_lock lock(mutex_);
    notes_.push_back(text);
  };
}

void LongCall::run(const std::function<void()>& work) {
  constexpr std::chrono::milliseconds between_looks{50};
  std::exception_ptr failure, of_python;
  {
    const py::gil_scoped_release without_lock;
    workers().start([&] {
      try {
        work();
      } catch (...) {
        failure = std::current_exception();
      }
      const std::scoped_lock lock(mutex_);
      is_done_ = true;
      changed_.notify_one();
    });
    for (bool is_done = false; !is_done;) {
      std::deque<StageProgress> stages;
      std::deque<std::string> notes;
      {
        std::unique_lock lock(mutex_);
        changed_.wait_for(lock, between_looks, [&] { return is_done_ || !stages_.empty(); });
        is_done = is_done_;
        stages.swap(stages_);
        notes.swap(notes_);
      }
      if (of_python) continue;
      const py::gil_scoped_acquire with_lock;
      try {
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        report(std::move(stages), std::move(notes));
      } catch (...) {
        of_python = std::current_exception();
        stop_ = true;
      }
    }
  }
  if (of_python) std::rethrow_exception(of_python);
  if (failure) std::rethrow_exception(failure);
}

void LongCall::report(std::deque<StageProgress> stages, std::deque<std::string> notes) {
  for (const std::string& note : notes) log_note(note);
  for (const StageProgress& stage : stages) progress_(stage.stage, stage.done, stage.total);
}

py::array array_of(std::vector<float>&& values, std::vector<py::ssize_t> shape) {
  auto owner = std::make_unique<std::vector<float>>(std::move(values));
  float* first = owner->data();
  const py::capsule keeper(owner.get(), [](void* p) { delete static_cast<std::vector<float>*>(p); });
  owner.release();
  return py::array_t<float>(std::move(shape), first, keeper);
}

py::array array_of(Image&& image) {
  std::vector<py::ssize_t> shape{image.height, image.width};
  if (image.channels != 1) shape.push_back(image.channels);
  return array_of(std::move(image.values), std::move(shape));
}

ImageView view_of(const Floats& array, const std::string& name) {
  require_images(array, 3, name);
  return view_at(array.data(), array, 0);
}

std::vector<ImageView> views_of(const Floats& array, const std::string& name) {
  require_images(array, 4, name);
  std::vector<ImageView> views;
  for (py::ssize_t i = 0; i < array.shape(0); ++i)
    views.push_back(
        view_at(array.data() + i * (array.strides(0) / static_cast<py::ssize_t>(sizeof(float))), array, 1));
  return views;
}

Mask mask_of(const std::optional<Flags>& mask, const std::vector<ImageView>& images) {
  if (!mask) return {};
  if (mask->ndim() != 2 || images.empty() || mask->shape(0) != images[0].height ||
      mask->shape(1) != images[0].width)
    throw InputError("mask: is not of the photographs' height×width");
  return {mask->data(), mask->data() + mask->size()};
}

py::object map_or_none(Image&& map) {
  if (map.empty()) return py::none();
  return array_of(std::move(map));
}

float* target_of(py::array& out, const std::vector<py::ssize_t>& shape) {
  const bool fits = py::isinstance<py::array_t<float>>(out) && shape_of(out) == text_of(shape) &&
                    (out.flags() & py::array::c_style) != 0 &&
                    (out.flags() & py::detail::npy_api::NPY_ARRAY_ALIGNED_) != 0 && out.writeable();
  if (!fits)
    throw InputError("out: is " + py::str(out.dtype()).cast<std::string>() + " of shape " + shape_of(out) +
                     "; give a writable, aligned float32 array of shape " + text_of(shape) + " in C order");
  return static_cast<float*>(out.mutable_data());
}

PYBIND11_MODULE(_refield, module) {
  pthread_atfork(nullptr, nullptr, [] { lost_threads = has_started.load(); });
  bind_errors(module);
  bind_field(module);
  bind_scenes(module);
  module.attr("version") = REFIELD_VERSION;
}

}  // namespace refield::python
