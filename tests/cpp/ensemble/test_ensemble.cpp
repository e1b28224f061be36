// Eigen adds up three products of one body in another order where it uses SIMD registers of its own.
#define EIGEN_DONT_VECTORIZE
#include <doctest/doctest.h>

#include <cstring>
#include <elliptude/ensemble/ensemble.hpp>
#include <random>
#include <vector>

using namespace elliptude;

namespace {

template <typename Number>
[[nodiscard]] RigidBody<Number> box() {
  Matrix3<Number> inertia;
  inertia << 2, 0.125, 0, 0.125, 3, 0.0625, 0, 0.0625, 4;
  RigidBody<Number> body;
  REQUIRE(RigidBody<Number>::make(inertia, body) == Status::ok);
  return body;
}

/// Bodies at random attitudes, from rest to turns of a quarter of a radian a step: Newton's method takes different numbers of rounds.
template <typename Number>
[[nodiscard]] std::vector<EnsembleMember<Number>> members(std::size_t count, Number step) {
  std::mt19937 generator(7);
  std::normal_distribution<double> normal;
  const auto vector = [&](double scale) {
    return Vector3<Number>(Number(scale * normal(generator)), Number(scale * normal(generator)),
                           Number(scale * normal(generator)));
  };
  std::vector<EnsembleMember<Number>> result(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double rate = i % 7 == 0 ? 0.0 : 0.15 / double(step) * std::pow(10.0, -double(i % 5));
    result[i] = {{exp(vector(1.0)), vector(rate)}, Number(0.25 * double(i)), vector(0.1 * double(i % 3))};
  }
  return result;
}

template <typename Derived>
[[nodiscard]] bool same_bits(const Eigen::MatrixBase<Derived>& a, const Eigen::MatrixBase<Derived>& b) {
  using Number = typename Derived::Scalar;
  return std::memcmp(a.derived().data(), b.derived().data(), sizeof(Number) * std::size_t(a.size())) == 0;
}

template <typename Number, int Width, template <typename> class Potential>
void moves_as_each_alone(const Potential<Number>& potential, int order) {
  const RigidBody<Number> body = box<Number>();
  const Number step = scalar::constant<Number>(0.02L);
  Composition<Number> composition{};
  REQUIRE(composition_of_order(order, composition) == Status::ok);
  const Ensemble<Number, Width, Potential> ensemble(body, potential, composition, step);
  constexpr std::size_t width = Width;
  for (const std::size_t count : {std::size_t{1}, width - 1, width, 3 * width + 1}) {
    const std::vector<EnsembleMember<Number>> start = members(count, step);
    std::vector<EnsembleMember<Number>> together = start;
    const EnsembleStatus done = ensemble.integrate(50, together.data(), count);
    REQUIRE(done.status == Status::ok);
    CHECK(done.member == count);
    std::vector<EnsembleMember<Number>> linearized = start;
    std::vector<FlowLinearization<Number>> linearizations(count);
    REQUIRE(ensemble.integrate_linearized(50, linearized.data(), count, linearizations.data()).status == Status::ok);
    for (std::size_t i = 0; i < count; ++i) {
      RigidBodyState<Number> alone;
      FlowLinearization<Number> linearization;
      REQUIRE(integrate_linearized(body, potential, composition, start[i].time, step, 50L, start[i].control_torque,
                                   start[i].state, alone, linearization) == Status::ok);
      CHECK(same_bits(together[i].state.attitude, alone.attitude));
      CHECK(same_bits(together[i].state.angular_velocity, alone.angular_velocity));
      CHECK(same_bits(linearized[i].state.attitude, alone.attitude));
      CHECK(same_bits(linearized[i].state.angular_velocity, alone.angular_velocity));
      CHECK(same_bits(linearizations[i].state, linearization.state));
      CHECK(same_bits(linearizations[i].control, linearization.control));
    }
  }
}

template <typename Number, int Width>
void all_potentials() {
  UniformGravity<Number> gravity;
  REQUIRE(UniformGravity<Number>::make(Number(1), Number(9.81), Vector3<Number>(Number(0), Number(0.02), Number(0.3)),
                                       gravity) == Status::ok);
  GravityGradient<Number> gradient;
  REQUIRE(GravityGradient<Number>::make(box<Number>(), Number(0.1), Matrix3<Number>::Identity(), gradient) ==
          Status::ok);
  for (const int order : {2, 4}) {
    moves_as_each_alone<Number, Width>(FreeBody<Number>(), order);
    moves_as_each_alone<Number, Width>(gravity, order);
    moves_as_each_alone<Number, Width>(gradient, order);
  }
}

}  // namespace

TEST_CASE("an ensemble moves each member as it moves alone, to the last bit, whatever its neighbours do") {
  SUBCASE("two doubles") { all_potentials<double, 2>(); }
  SUBCASE("eight doubles") { all_potentials<double, 8>(); }
  SUBCASE("four floats") { all_potentials<float, 4>(); }
}

TEST_CASE("the first member that cannot move is named, and those before it have moved") {
  const double step = 0.02;
  Composition<double> composition{};
  REQUIRE(composition_of_order(2, composition) == Status::ok);
  const Ensemble<double, 4, FreeBody> ensemble(box<double>(), FreeBody<double>(), composition, step);
  std::vector<EnsembleMember<double>> bodies = members<double>(11, step);
  const std::vector<EnsembleMember<double>> start = bodies;
  SUBCASE("a step that is too long") {
    bodies[6].state.angular_velocity = Vector3<double>(500, 0, 0);
    const EnsembleStatus done = ensemble.integrate(3, bodies.data(), bodies.size());
    CHECK(done.status == Status::step_too_long);
    CHECK(done.member == 6);
    CHECK(same_bits(bodies[6].state.attitude, start[6].state.attitude));
    std::vector<EnsembleMember<double>> alone = start;
    REQUIRE(ensemble.integrate(3, alone.data(), 6).status == Status::ok);
    CHECK(same_bits(bodies[5].state.attitude, alone[5].state.attitude));
  }
  SUBCASE("a rate that is not finite") {
    bodies[10].state.angular_velocity(1) = std::nan("");
    std::vector<FlowLinearization<double>> linearizations(bodies.size());
    const EnsembleStatus done = ensemble.integrate_linearized(3, bodies.data(), bodies.size(), linearizations.data());
    CHECK(done.status == Status::not_finite);
    CHECK(done.member == 10);
  }
}

TEST_CASE("masks of packs combine lane by lane") {
  using Four = Pack<double, 4>;
  Four a(1.0);
  a.set(2, 3.0);
  CHECK_FALSE(all_of(a < Four(2.0)));
  CHECK(all_of(a < Four(2.0) || a == Four(3.0)));
  CHECK(all_of(!(a < Four(2.0) && a == Four(3.0))));
  const Four chosen = select(a < Four(2.0), Four(-1.0), a);
  CHECK(chosen[0] == -1.0);
  CHECK(chosen[2] == 3.0);
  CHECK(abs(chosen)[0] == 1.0);
  CHECK(sqrt(Four(9.0))[3] == 3.0);
}
