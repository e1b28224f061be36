/// \file What Python says of a call whose arguments do not fit, and of objects that have nothing else to say.

#include <exception>
#include <string>

#include "module.hpp"

namespace py = pybind11;

namespace elliptude::python {

namespace {

/// pybind11 calls every function of the module through one, by this convention of Python's.
using Dispatcher = PyObject* (*)(PyObject*, PyObject* const*, size_t, PyObject*);
constexpr int convention = METH_FASTCALL | METH_KEYWORDS;
Dispatcher pybind11_dispatcher = nullptr;

/// Puts a sentence that names the argument in place of pybind11's list of signatures and values, or returns false.
bool say_what_is_wrong(const py::error_already_set& error, PyObject* const* values, Py_ssize_t count, PyObject* names) {
  const std::string message = py::str(error.value());
  if (message.find("(): incompatible ") == std::string::npos) {
    return false;
  }
  py::tuple arguments(count);
  for (Py_ssize_t i = 0; i < count; ++i) {
    arguments[i] = py::reinterpret_borrow<py::object>(values[i]);
  }
  py::dict named;
  if (names != nullptr) {
    for (const py::handle name : py::reinterpret_borrow<py::tuple>(names)) {
      named[name] = py::reinterpret_borrow<py::object>(values[count + static_cast<Py_ssize_t>(named.size())]);
    }
  }
  const py::object said = py::module_::import("elliptude.errors").attr("_said_of_call")(message, arguments, named);
  if (said.is_none()) {
    return false;
  }
  PyErr_SetObject(PyExc_TypeError, said.ptr());
  return true;
}

/// Reports pybind11's complaint about a call, in our own words where there are any.
void report(py::error_already_set error, PyObject* const* values, Py_ssize_t count, PyObject* names) {
  // What a function written in Python has raised, one that a call of ours has called, is not about our arguments.
  const bool is_ours = !error.trace();
  try {
    if (is_ours && say_what_is_wrong(error, values, count, names)) {
      return;
    }
  } catch (py::error_already_set& why) {
    // What was said first is better than why it could not be said better; but Ctrl-C is not about the words.
    if (!why.matches(PyExc_Exception)) {
      why.restore();
      return;
    }
  }
  error.restore();
}

/// Nothing may be thrown through Python's own functions, which call this.
PyObject* dispatch(PyObject* self, PyObject* const* values, size_t count_and_flags, PyObject* names) noexcept {
  try {
    PyObject* result = pybind11_dispatcher(self, values, count_and_flags, names);
    if (result == nullptr && PyErr_ExceptionMatches(PyExc_TypeError) != 0) {
      report(py::error_already_set(), values, PyVectorcall_NARGS(count_and_flags), names);
    }
    return result;
  } catch (py::error_already_set& error) {  // of pybind11 itself, as for a name that is no text
    error.restore();
  } catch (const std::exception& error) {
    PyErr_SetString(PyExc_RuntimeError, error.what());
  }
  return nullptr;
}

void dispatch_through_us(const py::handle& callable) {
  py::object unwrapped = py::reinterpret_borrow<py::object>(callable);
  if (PyObject_TypeCheck(callable.ptr(), &PyStaticMethod_Type) != 0) {
    unwrapped = callable.attr("__func__");
  }
  PyObject* function = unwrapped.ptr();
  if (PyInstanceMethod_Check(function)) {
    function = PyInstanceMethod_GET_FUNCTION(function);
  }
  if (!PyCFunction_Check(function)) {
    return;
  }
  PyMethodDef* definition = reinterpret_cast<PyCFunctionObject*>(function)->m_ml;
  // An older pybind11 has another convention, and keeps its own messages.
  if (definition->ml_flags != convention) {
    return;
  }
  const auto dispatcher = reinterpret_cast<Dispatcher>(reinterpret_cast<void (*)()>(definition->ml_meth));
  if (dispatcher == dispatch || (pybind11_dispatcher != nullptr && dispatcher != pybind11_dispatcher)) {
    return;
  }
  pybind11_dispatcher = dispatcher;
  definition->ml_meth = reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(dispatch));
}

}  // namespace

void define_what_is_said(py::module_& module) {
  const py::object no_repr = py::module_::import("builtins").attr("object").attr("__repr__");
  for (const auto& entry : py::reinterpret_borrow<py::dict>(module.attr("__dict__"))) {
    dispatch_through_us(entry.second);
    if (!py::isinstance<py::type>(entry.second)) {
      continue;
    }
    const auto type = py::reinterpret_borrow<py::type>(entry.second);
    if (py::object(type.attr("__repr__")).is(no_repr)) {
      type.attr("__repr__") = py::cpp_function(
          [](const py::object& self) { return py::module_::import("elliptude.errors").attr("_shown")(self); },
          py::name("__repr__"), py::is_method(type));
    }
    for (const auto& member : py::reinterpret_borrow<py::dict>(py::dict(type.attr("__dict__")))) {
      dispatch_through_us(member.second);
    }
  }
}

}  // namespace elliptude::python
