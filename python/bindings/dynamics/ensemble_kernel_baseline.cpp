#define ELLIPTUDE_MOVE move_baseline
#define ELLIPTUDE_SOLVE_WAHBA solve_wahba_baseline
#define ELLIPTUDE_WIDTH 2
#define elliptude elliptude_baseline
#define Eigen Eigen_baseline
#include "dynamics/ensemble_kernel_body.hpp"
