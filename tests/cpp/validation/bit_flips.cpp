// bit_flips [TRIALS [SEED]]: bits are flipped in the memory of filters of both kinds, in C++ and in C, between an update and the next
// prediction.
// With their seals: each bit of the memory by itself, and TRIALS times two of them, have to be noticed, before anything is done.
// Without: what one or two flipped bits do, in TRIALS processes of their own, by where they are. This is counted, and cannot fail.

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>

#include "support/faults/c_subject.hpp"
#include "support/faults/campaign.hpp"

namespace {

using namespace elliptude;
using namespace elliptude::faults;

#if defined(__SANITIZE_ADDRESS__)
constexpr bool is_sanitized = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
constexpr bool is_sanitized = true;
#else
constexpr bool is_sanitized = false;
#endif
#else
constexpr bool is_sanitized = false;
#endif

using Body = GuaranteedSubject<GuaranteedRigidBodyFlow<double, FreeBody<double>>>;
using Gyro = GuaranteedSubject<GuaranteedGyroFlow<double>>;
using Paper = FirstOrderSubject<RigidBodyFlow<double, FreeBody<double>>, PaperEstimator>;

void flip(Subject& subject, std::size_t bit) {
  subject.bytes()[bit / 8] = static_cast<unsigned char>(subject.bytes()[bit / 8] ^ (1U << bit % 8));
}

std::size_t any_bit(Random& random, std::size_t first_byte, std::size_t size) {
  return 8 * first_byte + static_cast<std::size_t>(random.uniform(0, 8 * static_cast<double>(size)));
}

/// Tells a subject what honest sensors say, for a few moments.
void warm_up(Subject& subject, World& world, Supervisor& supervisor, Random& random) {
  if (subject.make(world.honest(random)) != ELLIPTUDE_OK) {
    std::abort();
  }
  for (int k = 0; k < 4; ++k) {
    (void)supervisor.cycle(world.honest(random));
    world.advance();
  }
}

/// \return whether a call refuses the memory as it is, and leaves it so.
bool is_refused(Subject& subject, const Moment& moment) {
  const std::vector<unsigned char> before(subject.bytes(), subject.bytes() + subject.size());
  const int predicted = subject.predict(moment);
  const int updated = subject.update(moment).status;
  const auto refuses = [](int status) { return status == ELLIPTUDE_CORRUPTED || status == ELLIPTUDE_NOT_INITIALIZED; };
  return refuses(predicted) && refuses(updated) && refuses(subject.check()) &&
         std::memcmp(before.data(), subject.bytes(), subject.size()) == 0;
}

/// Each bit by itself, and pairs.
/// \return how many were not noticed.
long unnoticed(const char* name, Subject& subject, long pairs, Random& random) {
  Outcome ignored;
  World world(subject.kind(), random);
  Supervisor supervisor(subject, ignored, Rules().regain_after);
  warm_up(subject, world, supervisor, random);
  const Moment moment = world.honest(random);
  long missed = 0;
  const std::size_t bits = 8 * subject.size();
  for (std::size_t bit = 0; bit < bits; ++bit) {
    flip(subject, bit);
    missed += !is_refused(subject, moment);
    flip(subject, bit);
  }
  for (long pair = 0; pair < pairs; ++pair) {
    const std::size_t one = any_bit(random, 0, subject.size());
    const std::size_t other = (one + 1 + any_bit(random, 0, subject.size()) % (bits - 1)) % bits;
    flip(subject, one);
    flip(subject, other);
    missed += !is_refused(subject, moment);
    flip(subject, one);
    flip(subject, other);
  }
  const bool goes_on = supervisor.cycle(moment);
  missed += !goes_on;  // all is again as it was
  std::printf("sealed   %-18s %6zu bytes, each of %zu bits and %ld pairs: %ld not noticed\n", name, subject.size(),
              bits, pairs, missed);
  return missed;
}

// --- without a seal -----------------------------------------------------------------------------------------------------

/// What came of flipped bits that no seal has shown; as the exit code of a process.
enum class Effect : std::uint8_t { none, noticed, silent, lasting, invalid, crashed, hung };
constexpr std::array<const char*, 7> effect_names{"no effect", "noticed", "silent", "lasting",
                                                  "invalid",   "crashed", "hung"};

/// Honest moments after bits were flipped: by how the filter says what, and whether it is so.
template <typename Tried>
Effect effect_of(Tried& subject, std::size_t one, std::size_t other, Random& random) {
  Outcome outcome;
  World world(subject.kind(), random);
  Supervisor supervisor(subject, outcome, Rules().regain_after);
  warm_up(subject, world, supervisor, random);
  outcome = {};
  flip(subject, one);
  if (other != one) {
    flip(subject, other);
  }
  subject.seal_as_it_is();
  bool silent = false;
  bool holds = true;
  for (int k = 0; k < 16; ++k) {
    (void)supervisor.cycle(world.honest(random));
    const Belief belief = subject.belief();
    holds = !belief.knows || form(belief, world, subject.is_guaranteed()) <= 1;
    silent = silent || (belief.unconditional && !holds && !outcome.detected);
    if (outcome.broken != nullptr) {
      return Effect::invalid;
    }
    world.advance();
  }
  const bool wrong_at_end = subject.belief().unconditional && !holds;
  return wrong_at_end ? Effect::lasting : silent ? Effect::silent : outcome.detected ? Effect::noticed : Effect::none;
}

/// The same in a process of its own, which may crash or not end.
template <typename Tried>
Effect effect_apart(std::size_t one, std::size_t other, std::uint64_t seed) {
  const pid_t child = fork();
  if (child == 0) {
    if (freopen("/dev/null", "w", stderr) == nullptr) {
      _exit(100);
    }
    alarm(2);
    Random random(seed);
    Tried subject = [] {
      if constexpr (std::is_constructible_v<Tried, Rules>) {
        return Tried(Rules());
      } else {
        return Tried();
      }
    }();
    _exit(static_cast<int>(effect_of(subject, one, other, random)));
  }
  int status = 0;
  if (child < 0 || waitpid(child, &status, 0) != child) {
    std::abort();
  }
  if (WIFSIGNALED(status)) {
    return WTERMSIG(status) == SIGALRM ? Effect::hung : Effect::crashed;
  }
  if (WEXITSTATUS(status) >= static_cast<int>(effect_names.size())) {
    return Effect::crashed;
  }
  return static_cast<Effect>(WEXITSTATUS(status));
}

struct Part {
  const char* name;
  std::size_t begin;
  std::size_t size;
};

/// Where in the memory of a subject what its filter refers to is.
template <typename Tried, typename Object>
Part part(const char* name, const Tried& subject, const Object& object) {
  const auto* base = reinterpret_cast<const unsigned char*>(&subject.filter());
  return {name, static_cast<std::size_t>(reinterpret_cast<const unsigned char*>(&object) - base), sizeof object};
}

template <typename Tried>
void count_effects(const char* name, const Tried& subject, std::vector<Part> parts, long trials, Random& random) {
  parts.push_back({"anywhere", 0, sizeof subject.filter()});
  for (const Part& where : parts) {
    for (const int bits : {1, 2}) {
      std::array<long, effect_names.size()> counts{};
      for (long trial = 0; trial < trials; ++trial) {
        const std::size_t one = any_bit(random, where.begin, where.size);
        const std::size_t other = bits == 1 ? one : any_bit(random, where.begin, where.size);
        const auto seed = static_cast<std::uint64_t>(random.uniform(0, 1e15));
        ++counts[static_cast<std::size_t>(effect_apart<Tried>(one, other, seed))];
      }
      std::printf("unsealed %-18s %-10s %d bit%s", name, where.name, bits, bits == 1 ? " " : "s");
      for (std::size_t i = 0; i < counts.size(); ++i) {
        std::printf("  %s %.1f %%", effect_names[i],
                    100 * static_cast<double>(counts[i]) / static_cast<double>(trials));
      }
      std::printf("\n");
      std::fflush(stdout);
    }
  }
}

/// The places of a guaranteed filter's members.
template <typename Tried>
std::vector<Part> parts_of_guaranteed(const Tried& subject) {
  const auto& filter = subject.filter();
  return {part("set", subject, filter.ellipsoid()), part("flow", subject, filter.flow()),
          part("settings", subject, filter.settings()), part("trust", subject, filter.trust())};
}

}  // namespace

int main(int argc, char** argv) {
  const long trials = argc > 1 ? std::atol(argv[1]) : 10000;
  const long seed = argc > 2 ? std::atol(argv[2]) : 1;
  if (trials < 1 || argc > 3) {
    std::fprintf(stderr, "usage: %s [TRIALS [SEED]]\n", argv[0]);
    return 2;
  }
  Random random(static_cast<std::uint64_t>(seed));
  Body body{Rules()};
  Gyro gyro{Rules()};
  Paper paper;
  CSubject<BodyInC> body_in_c{Rules()};
  CSubject<GyroInC> gyro_in_c{Rules()};
  long missed = 0;
  missed += unnoticed("guaranteed, body", body, trials, random);
  missed += unnoticed("guaranteed, gyro", gyro, trials, random);
  missed += unnoticed("paper, body", paper, trials, random);
  missed += unnoticed("C, body", body_in_c, trials, random);
  missed += unnoticed("C, gyro", gyro_in_c, trials, random);
  if (!is_sanitized) {  // flipped bits are undefined behaviour where nothing looks for them
    std::fflush(stdout);
    count_effects("guaranteed, body", body, parts_of_guaranteed(body), trials, random);
    count_effects("guaranteed, gyro", gyro, parts_of_guaranteed(gyro), trials, random);
    count_effects("paper, body", paper,
                  {part("set", paper, paper.filter().ellipsoid()), part("flow", paper, paper.filter().flow())}, trials,
                  random);
  }
  std::printf("%ld not noticed by a seal\n", missed);
  return missed == 0 ? 0 : 1;
}
