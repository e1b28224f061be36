#define ELLIPTUDE_MOVE move_avx2
#define ELLIPTUDE_SOLVE_WAHBA solve_wahba_avx2
#define ELLIPTUDE_WIDTH 4
#define elliptude elliptude_avx2
#define Eigen Eigen_avx2
#include "dynamics/ensemble_kernel_body.hpp"
