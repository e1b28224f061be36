#define ELLIPTUDE_FILTERS filters_avx2
#define ELLIPTUDE_WIDTH 4
#define elliptude elliptude_avx2
#define Eigen Eigen_avx2
#include "first_order/filter_kernel_body.hpp"
