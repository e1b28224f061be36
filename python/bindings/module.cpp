#include "module.hpp"

#include <elliptude/version.hpp>
#include <exception>

#include "errors.hpp"

namespace py = pybind11;

PYBIND11_MODULE(_core, module) {
  using namespace elliptude::python;

  py::options options;
  options.disable_function_signatures();
  module.doc() = "The C++ core of elliptude.";
  module.attr("__version__") = elliptude::version_string;

  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) {
        std::rethrow_exception(thrown);
      }
    } catch (const InconsistentSets& error) {
      const py::object type = py::module_::import("elliptude.errors").attr("InconsistentMeasurement");
      const py::object row = error.row() < 0 ? py::object(py::none()) : py::int_(error.row());
      const py::object instance = type(error.what(), error.margin(), error.time(), error.sensor(), row);
      PyErr_SetObject(type.ptr(), instance.ptr());
    } catch (const RowFault& error) {
      const py::object type = py::module_::import("elliptude.errors").attr("RowError");
      PyErr_SetObject(type.ptr(), type(error.what(), error.row()).ptr());
    }
  });

  define_rotations(module);
  define_ellipsoids(module);
  define_quadrics(module);
  define_rigid_body(module);
  define_potentials(module);
  define_gravity_potentials(module);
  define_combined_potentials(module);
  define_own_potentials(module);
  define_integrator(module);
  define_wahba(module);
  define_state_ellipsoids(module);
  define_flows(module);
  define_filter(module);
  define_filters(module);
  define_guaranteed_flows(module);
  define_guaranteed_filter(module);
  define_direction_filter(module);
  define_what_is_said(module);
}
