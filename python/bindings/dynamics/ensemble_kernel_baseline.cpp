#define ELLIPTUDE_KERNEL move_baseline
#define ELLIPTUDE_WIDTH 2
#define elliptude elliptude_baseline
#define Eigen Eigen_baseline
#include "dynamics/ensemble_kernel_body.hpp"
