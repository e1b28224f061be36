#define ELLIPTUDE_FILTERS filters_avx512
#define ELLIPTUDE_WIDTH 8
#define elliptude elliptude_avx512
#define Eigen Eigen_avx512
#include "first_order/filter_kernel_body.hpp"
