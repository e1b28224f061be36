#define ELLIPTUDE_FILTERS filters_baseline
#define ELLIPTUDE_WIDTH 2
#define elliptude elliptude_baseline
#define Eigen Eigen_baseline
#include "first_order/filter_kernel_body.hpp"
