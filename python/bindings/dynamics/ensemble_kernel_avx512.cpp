#define ELLIPTUDE_MOVE move_avx512
#define ELLIPTUDE_SOLVE_WAHBA solve_wahba_avx512
#define ELLIPTUDE_WIDTH 8
#define elliptude elliptude_avx512
#define Eigen Eigen_avx512
#include "dynamics/ensemble_kernel_body.hpp"
