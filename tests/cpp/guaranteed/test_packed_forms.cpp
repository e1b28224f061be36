// Packed quadratic forms against the matrices that they stand for.
#include "elliptude/guaranteed/detail/packed_forms.hpp"
#include "elliptude/linear/triangular.hpp"

#include <doctest/doctest.h>

#include <array>

#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

Matrix6<double> symmetric(Random& random) {
  const Matrix6<double> a = random.normal_matrix<6, 6>();
  return a + a.transpose();
}

/// The form of a symmetric matrix.
detail::packed::Form<double> pack(const Matrix6<double>& matrix) {
  detail::packed::Form<double> form;
  for (int d = 0; d < 4; ++d) {
    for (int j = 0; j < 6; ++j) {
      form(6 * d + j) = detail::packed::weight<double>(d) * matrix(j, (j + d) % 6);
    }
  }
  return form;
}

detail::packed::Forms<double> random_forms(Random& random) {
  detail::packed::Forms<double> forms;
  for (int i = 0; i < 6; ++i) {
    forms.col(i) = pack(symmetric(random));
  }
  return forms;
}

detail::packed::Slices<double> slices_of(const detail::packed::Forms<double>& forms) {
  return detail::packed::seen_from<double>(forms, Matrix6<double>::Identity(), Matrix6<double>::Identity());
}

Matrix6<double> matrix_of(const detail::packed::Slices<double>& slices, int i) {
  return detail::packed::slice(slices, i).topRows<6>();
}

Matrix6<double> matrix_of(const detail::packed::Form<double>& form) {
  return detail::packed::unpacked(form).topRows<6>();
}

/// (aᵀu)(bᵀu), put together from its parts.
detail::packed::Form<double> whole_product(const Vector6<double>& a, const Vector6<double>& b) {
  using Factor = detail::packed::Factor<double>;
  detail::packed::Form<double> form;
  for (int at = 0; at < detail::packed::size; at += detail::packed::part_size) {
    form.segment<detail::packed::part_size>(at) = detail::packed::product(Factor(a, at), Factor(b, at));
  }
  return form;
}

Vector6<double> values(const detail::packed::Forms<double>& forms, const Vector6<double>& u) {
  Vector6<double> result;
  for (int i = 0; i < 6; ++i) {
    result(i) = u.dot(matrix_of(forms.col(i)) * u);
  }
  return result;
}

Vector6<double> values(const detail::packed::Slices<double>& slices, const Vector6<double>& u) {
  Vector6<double> result;
  for (int i = 0; i < 6; ++i) {
    result(i) = u.dot(matrix_of(slices, i) * u);
  }
  return result;
}

}  // namespace

TEST_CASE("a form's value is the inner product with the packed square of its argument, of length |u|^2") {
  Random random(1);
  for (int trial = 0; trial < 20; ++trial) {
    const Matrix6<double> h = symmetric(random);
    const Vector6<double> u = random.normal_matrix<6>();
    const detail::packed::Form<double> square = pack(Matrix6<double>(u * u.transpose()));
    CHECK(square.norm() == doctest::Approx(u.squaredNorm()).epsilon(1e-14));
    CHECK(pack(h).dot(square) == doctest::Approx(u.dot(h * u)).epsilon(1e-12));
    CHECK((matrix_of(pack(h)) - h).norm() <= 1e-15 * h.norm());
    CHECK(pack(h).norm() == doctest::Approx(h.norm()).epsilon(1e-14));
  }
}

TEST_CASE("the product of two linear forms") {
  Random random(2);
  for (int trial = 0; trial < 20; ++trial) {
    const Vector6<double> a = random.normal_matrix<6>();
    const Vector6<double> b = random.normal_matrix<6>();
    const Matrix6<double> expected = 0.5 * (a * b.transpose() + b * a.transpose());
    CHECK((matrix_of(whole_product(a, b)) - expected).norm() <= 1e-15 * expected.norm());
  }
}

TEST_CASE("the six products of three linear forms") {
  Random random(6);
  const Eigen::Matrix<double, 3, 6> a = random.normal_matrix<3, 6>();
  const std::array<std::array<int, 2>, 6> pairs{{{0, 0}, {1, 1}, {2, 2}, {1, 2}, {2, 0}, {0, 1}}};
  for (int at = 0; at < detail::packed::size; at += detail::packed::part_size) {
    const auto parts = detail::packed::products(detail::packed::factors_of<double>(a, at));
    for (std::size_t i = 0; i < 6; ++i) {
      const detail::packed::Form<double> expected = whole_product(a.row(pairs[i][0]), a.row(pairs[i][1]));
      CHECK((parts.col(static_cast<int>(i)) - expected.segment<detail::packed::part_size>(at)).norm() <= 1e-15);
    }
  }
}

TEST_CASE("a quadratic map in the coordinates of a set is the map there and back") {
  Random random(3);
  const detail::packed::Forms<double> forms = random_forms(random);
  const Matrix6<double> map = random.normal_matrix<6, 6>().triangularView<Eigen::Lower>();
  const Matrix6<double> inverse = lower_inverse(map);
  const detail::packed::Slices<double> seen = detail::packed::seen_from(forms, map, inverse);
  for (int trial = 0; trial < 20; ++trial) {
    const Vector6<double> v = random.normal_matrix<6>();
    const Vector6<double> expected = map.inverse() * values(forms, map * v);
    CHECK((values(seen, v) - expected).norm() <= 1e-11 * expected.norm());
  }
  for (int i = 0; i < 6; ++i) {
    CHECK(matrix_of(seen, i) == matrix_of(seen, i).transpose());
  }
}

TEST_CASE("columns of slices have the inner products of the forms, and end in zeros") {
  Random random(5);
  const detail::packed::Forms<double> forms = random_forms(random);
  const detail::packed::Slices<double> slices = slices_of(forms);
  CHECK((slices.transpose() * slices - forms.transpose() * forms).norm() <= 1e-14 * forms.squaredNorm());
  for (int i = 0; i < 6; ++i) {
    CHECK(detail::packed::slice(slices, i).bottomRows<padded(6) - 6>().isZero(0));
    CHECK(detail::packed::slice(detail::packed::symmetric_part(slices), i).bottomRows<padded(6) - 6>().isZero(0));
  }
}

TEST_CASE("the symmetric part has the same cubic form and the least norm") {
  Random random(4);
  const detail::packed::Slices<double> slices = slices_of(random_forms(random));
  const detail::packed::Slices<double> part = detail::packed::symmetric_part(slices);
  for (int trial = 0; trial < 20; ++trial) {
    const Vector6<double> u = random.normal_matrix<6>();
    const double expected = u.dot(values(slices, u));
    CHECK(u.dot(values(part, u)) ==
          doctest::Approx(expected).epsilon(1e-11).scale(u.norm() * values(slices, u).norm()));
  }
  CHECK(part.norm() <= slices.norm());
  // It is symmetric: taking its symmetric part changes nothing, and slice i at (j, k) is slice j at (k, i).
  CHECK((detail::packed::symmetric_part(part) - part).norm() <= 1e-14 * part.norm());
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      for (int k = 0; k < 6; ++k) {
        CHECK(matrix_of(part, i)(j, k) == doctest::Approx(matrix_of(part, j)(k, i)).epsilon(1e-12));
      }
    }
  }
  // What only turns u has no symmetric part: q(u) = u(0) S u with a skew S.
  const Matrix6<double> a = random.normal_matrix<6, 6>();
  const Matrix6<double> skew = a - a.transpose();
  detail::packed::Forms<double> turning;
  for (int i = 0; i < 6; ++i) {
    turning.col(i) = whole_product(Vector6<double>::Unit(0), Vector6<double>(skew.row(i)));
  }
  CHECK(detail::packed::symmetric_part(slices_of(turning)).norm() <= 1e-14 * turning.norm());
}
