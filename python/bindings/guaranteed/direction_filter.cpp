#include <elliptude/guaranteed/direction_filter.hpp>

#include "guaranteed/policies.hpp"
#include "guaranteed/rows.hpp"
#include "measurement/arguments.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

using Cap = DirectionCap<double>;

void require_angle(double angle, const std::string& name) {
  if (!(angle >= 0)) {
    value_error(name + " must not be negative, but is " + text(angle) + " rad");
  }
}

/// The filter as Python has it. The docstrings below describe the functions.
class PythonDirectionFilter {
 public:
  PythonDirectionFilter(const std::string& policy, int regain_after) {
    const Policy chosen = policy_of(policy);
    if (chosen == Policy::relaxed) {
      value_error("policy 'relaxed' needs several measurements at once, and this filter has one");
    }
    if (regain_after < 1) {
      value_error("regain_after must be at least 1, but is " + std::to_string(regain_after));
    }
    raise_unless_ok(DirectionFilter<double>::make({chosen, regain_after}, filter_), "policy");
  }

  [[nodiscard]] const char* policy() const { return policies[static_cast<std::size_t>(filter_.settings().policy)]; }
  [[nodiscard]] int regain_after() const { return filter_.settings().regain_after; }
  [[nodiscard]] const char* claim() const { return name_of(filter_.claim()); }
  [[nodiscard]] py::object direction() const {
    return filter_.knows_direction() ? py::object(to_array(filter_.cap().center)) : py::object(py::none());
  }
  [[nodiscard]] double angle() const { return filter_.cap().angle; }

  void forget() {
    const std::unique_lock lock = exclusive(*mutex_);
    filter_.forget();
  }

  void predict_turn(const py::object& turn, const py::object& turn_bound) {
    const std::unique_lock lock = exclusive(*mutex_);
    const Vector3<double> rotation_vector = single(turn, "turn", {3}).vector<3>(0);
    const double angle = angle_of(turn_bound, "turn_bound");
    require_angle(angle, "turn_bound");
    raise_unless_ok(filter_.predict_turn(rotation_vector, angle), "turn");
  }

  [[nodiscard]] py::object update(const py::object& direction, const py::object& bound) {
    const std::unique_lock lock = exclusive(*mutex_);
    const Cap measured{single(direction, "direction", {3}).vector<3>(0), angle_of(bound, "bound")};
    DirectionUpdate update;
    fuse(filter_, measured, "direction", "bound", update);
    return py::module_::import("elliptude.results")
        .attr("DirectionUpdate")(name_of(update.claim), update.prediction_used, update.contradicts, update.dropped);
  }

  [[nodiscard]] py::object run_turns(const py::object& turns, const py::object& turn_bounds, const py::object& anchors,
                                     const py::object& directions, const py::object& bounds) {
    const std::unique_lock lock = exclusive(*mutex_);
    const Items turn = single(turns, "turns", {any_length, 3});
    const Index rows = turn.item()[0];
    const Items angle(turn_bounds, "turn_bounds", {rows}, Items::Require::anything, Items::Batch::none);
    const Anchors from(anchors, rows);
    const Items direction(directions, "directions", {rows, 3}, Items::Require::anything, Items::Batch::none);
    const Items bound(bounds, "bounds", {rows}, Items::Require::anything, Items::Batch::none);
    Results found({rows}, {3});
    Results angles({rows}, {});
    py::array_t<std::uint8_t> claim(rows);
    py::array_t<bool> dropped(rows);
    std::uint8_t* const claim_data = claim.mutable_data();
    bool* const dropped_data = dropped.mutable_data();
    run_on_copy(filter_, [&](DirectionFilter<double>& working, Index& row) {
      const py::gil_scoped_release release;
      DirectionFilter<double> anchor = working;
      for (; row < rows; ++row) {
        if (from.begins_at_row_before(row)) {
          anchor = working;
        } else {
          working = anchor;
        }
        const std::string place = "[" + std::to_string(row) + "]";
        require_angle(angle[0][row], "turn_bounds" + place);
        raise_unless_ok(working.predict_turn(Eigen::Map<const Vector3<double>>(turn[0] + 3 * row), angle[0][row]),
                        "turns" + place);
        DirectionUpdate update;
        const Eigen::Map<const Vector3<double>> measured(direction[0] + 3 * row);
        if (!measured.array().isNaN().all() && bound[0][row] < scalar::pi<double>()) {
          fuse(working, {measured, bound[0][row]}, "directions" + place, "bounds" + place, update);
        }
        const bool known = working.knows_direction();
        found.set(row, known ? working.cap().center : Vector3<double>(Vector3<double>::Constant(nan_)));
        angles.set(row, known ? working.cap().angle : nan_);
        claim_data[row] = code_of(working.claim());
        dropped_data[row] = update.dropped;
      }
    });
    return py::module_::import("elliptude.results").attr("DirectionLog")(found.array(), angles.array(), claim, dropped);
  }

 private:
  static constexpr double nan_ = std::numeric_limits<double>::quiet_NaN();

  /// A bound, which may be infinite.
  [[nodiscard]] static double angle_of(const py::object& value, const char* name) {
    return Items(value, name, {}, Items::Require::anything, Items::Batch::none).number(0);
  }

  static void fuse(DirectionFilter<double>& filter, const Cap& measured, const std::string& direction,
                   const std::string& bound, DirectionUpdate& update) {
    require_angle(measured.angle, bound);
    const Status status = filter.update(measured, update);
    if (status == Status::empty_intersection) {
      throw InconsistentSets("the measured direction and the predicted one are farther apart than their bounds, " +
                                 text(measured.angle) + " and " + text(filter.cap().angle) +
                                 " rad, allow; some bound is wrong",
                             -1.0);
    }
    raise_unless_ok(status, direction);
  }

  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
  DirectionFilter<double> filter_;
};

}  // namespace

void define_direction_filter(py::module_& module) {
  using namespace py::literals;
  using Filter = PythonDirectionFilter;

  py::class_<Filter>(module, "DirectionFilter", R"(DirectionFilter(policy='raise', regain_after=10)
--

Follows one direction, such as the vertical, in the axes of a turning body: a cap of the sphere that holds it if all bounds hold.

It needs no other direction and no heading: a gyro's turn with an error of at most φ makes the cap's angle larger by φ. So what is
known of tilt lasts as long as it is measured, whether or not the attitude is known.

Parameters
----------
policy : {'raise', 'drop_measurement', 'restart'}
    What to do with a measurement that has no direction in common with the prediction, which proves that some bound is wrong.
regain_after : int
    As for GuaranteedFilter: after a contradiction the cap is taken from a measurement alone as soon as this many updates have agreed,
    or have passed.

Raises
------
ValueError
    If a policy is unknown, or regain_after below 1.
)")
      .def(py::init<const std::string&, int>(), "policy"_a = "raise", "regain_after"_a = 10,
           "__init__(self, policy='raise', regain_after=10)\n--\n\n")
      .def_property_readonly("policy", &Filter::policy, "What is done with a measurement that contradicts.")
      .def_property_readonly("regain_after", &Filter::regain_after,
                             "After how many updates without contradiction a conditional claim ends.")
      .def_property_readonly(
          "claim", &Filter::claim,
          "What the cap rests on: 'unconditional', 'conditional' or 'none', as for GuaranteedFilter.")
      .def_property_readonly(
          "direction", &Filter::direction,
          "Where the direction is, a unit vector in body axes, shape (3,); None if nothing is known.")
      .def_property_readonly("angle", &Filter::angle, "How far it may be from there, rad; pi if nothing is known.")
      .def("forget", &Filter::forget, R"(forget(self)
--

Forgets the direction, and what was dropped.
)")
      .def("predict_turn", &Filter::predict_turn, "turn"_a, "turn_bound"_a, R"(predict_turn(self, turn, turn_bound)
--

The body has turned.

Parameters
----------
turn : (3,) array_like
    Rotation vector, rad, body axes.
turn_bound : float
    The true turn differs by a turn about any axis of at most this, rad; from pi on the direction is forgotten.

Raises
------
ValueError
    If a number is not finite, or the bound negative.
)")
      .def("update", &Filter::update, "direction"_a, "bound"_a, R"(update(self, direction, bound)
--

The direction was measured.

Parameters
----------
direction : (3,) array_like
    In body axes, of any length.
bound : float
    How far it may be off, rad; from pi on it says nothing.

Returns
-------
DirectionUpdate

Raises
------
InconsistentMeasurement
    If it contradicts the prediction, under the policy 'raise'.
ValueError
    If a number is not finite, the direction zero, or the bound negative.
)")
      .def("run_turns", &Filter::run_turns, "turns"_a, "turn_bounds"_a, py::kw_only(), "anchors"_a, "directions"_a,
           "bounds"_a, R"(run_turns(self, turns, turn_bounds, *, anchors, directions, bounds)
--

Predicts each row of a log from its anchor, an earlier row, over a known turn, and updates it with its measurement, in one call.

Parameters
----------
turns : (n, 3) array_like
    turns[k] is the rotation vector from the attitude at row anchors[k] to that at row k, rad, body axes.
turn_bounds : (n,) array_like
    How far each may be off, rad, about any axis.
anchors : (n,) array_like of int
    As for `GuaranteedFilter.run_turns`.
directions : (n, 3) array_like
    Measured, body axes, NaN where nothing was.
bounds : (n,) array_like
    How far they may be off, rad; NaN, or pi and more, where nothing was measured.

Returns
-------
DirectionLog

Raises
------
InconsistentMeasurement
    With the row; the filter is then predicted to that row. After any other error it is as before the call.
RowError
    If a row has a number that is not finite or out of its range; with the row.
)");
}

}  // namespace elliptude::python
