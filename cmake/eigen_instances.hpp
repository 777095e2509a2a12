// SPDX-License-Identifier: BSD-3-Clause
// Eigen's products and decompositions of matrices of double are compiled once, in eigen_instances.cpp, not again in each of the
// files that use them, which takes 10 to 20 % of the time of those. Included by what is precompiled; nothing else needs it, and
// without it (-DRANGECAL_PRECOMPILE=OFF) or with another Eigen every file has its own.
#include <Eigen/Dense>

#ifdef RANGECAL_COMPILES_EIGEN
#define RANGECAL_EIGEN template
#else
#define RANGECAL_EIGEN extern template
#endif

#if EIGEN_VERSION_AT_LEAST(3, 4, 0) && !EIGEN_VERSION_AT_LEAST(3, 4, 90)
namespace Eigen {

RANGECAL_EIGEN class LLT<MatrixXd>;
RANGECAL_EIGEN LLT<MatrixXd>& LLT<MatrixXd>::compute<MatrixXd>(const EigenBase<MatrixXd>&);
RANGECAL_EIGEN void LLT<MatrixXd>::_solve_impl_transposed<true, VectorXd, VectorXd>(const VectorXd&,
                                                                                    VectorXd&) const;
RANGECAL_EIGEN void LLT<MatrixXd>::_solve_impl_transposed<true, MatrixXd, MatrixXd>(const MatrixXd&,
                                                                                    MatrixXd&) const;
RANGECAL_EIGEN class LDLT<MatrixXd>;
RANGECAL_EIGEN LDLT<MatrixXd>& LDLT<MatrixXd>::compute<MatrixXd>(const EigenBase<MatrixXd>&);
RANGECAL_EIGEN void LDLT<MatrixXd>::_solve_impl_transposed<true, VectorXd, VectorXd>(const VectorXd&,
                                                                                     VectorXd&) const;
RANGECAL_EIGEN void LDLT<MatrixXd>::_solve_impl_transposed<true, MatrixXd, MatrixXd>(const MatrixXd&,
                                                                                     MatrixXd&) const;
RANGECAL_EIGEN class PartialPivLU<MatrixXd>;
RANGECAL_EIGEN PartialPivLU<MatrixXd>::PartialPivLU(const EigenBase<MatrixXd>&);
RANGECAL_EIGEN class ColPivHouseholderQR<MatrixXd>;
RANGECAL_EIGEN ColPivHouseholderQR<MatrixXd>& ColPivHouseholderQR<MatrixXd>::compute<MatrixXd>(
    const EigenBase<MatrixXd>&);
RANGECAL_EIGEN class SelfAdjointEigenSolver<MatrixXd>;
RANGECAL_EIGEN SelfAdjointEigenSolver<MatrixXd>& SelfAdjointEigenSolver<MatrixXd>::compute<MatrixXd>(
    const EigenBase<MatrixXd>&, int);
RANGECAL_EIGEN class SelfAdjointEigenSolver<Matrix2d>;
RANGECAL_EIGEN SelfAdjointEigenSolver<Matrix2d>& SelfAdjointEigenSolver<Matrix2d>::compute<Matrix2d>(
    const EigenBase<Matrix2d>&, int);

namespace internal {

// within the decompositions
RANGECAL_EIGEN Index llt_inplace<double, Lower>::blocked<MatrixXd>(MatrixXd&);
RANGECAL_EIGEN Index llt_inplace<double, Lower>::unblocked<MatrixXd>(MatrixXd&);
RANGECAL_EIGEN Index llt_inplace<double, Lower>::unblocked<Block<MatrixXd>>(Block<MatrixXd>&);
RANGECAL_EIGEN bool ldlt_inplace<Lower>::unblocked<MatrixXd, Transpositions<Dynamic>, VectorXd>(
    MatrixXd&, Transpositions<Dynamic>&, VectorXd&, SignMatrix&);
RANGECAL_EIGEN struct partial_lu_impl<double, ColMajor, int>;

// products; a result by rows is the transposed of one by columns
RANGECAL_EIGEN struct gebp_kernel<
    double, double, Index, blas_data_mapper<double, Index, ColMajor, Unaligned, 1>,
    gebp_traits<double, double>::mr, gebp_traits<double, double>::nr, false, false>;
RANGECAL_EIGEN void evaluateProductBlockingSizesHeuristic<double, double, 1, Index>(Index&, Index&, Index&,
                                                                                    Index);
RANGECAL_EIGEN void evaluateProductBlockingSizesHeuristic<double, double, 4, Index>(Index&, Index&, Index&,
                                                                                    Index);
#define RANGECAL_EIGEN_PRODUCT(a, b)                                                                        \
  RANGECAL_EIGEN struct general_matrix_matrix_product<Index, double, a, false, double, b, false, ColMajor,  \
                                                      1>;                                                   \
  RANGECAL_EIGEN struct general_matrix_matrix_triangular_product<Index, double, a, false, double, b, false, \
                                                                 ColMajor, 1, Lower>;                       \
  RANGECAL_EIGEN struct general_matrix_vector_product<                                                      \
      Index, double, const_blas_data_mapper<double, Index, a>, a, false, double,                            \
      const_blas_data_mapper<double, Index, b>, false, 0>;
RANGECAL_EIGEN_PRODUCT(ColMajor, ColMajor)
RANGECAL_EIGEN_PRODUCT(ColMajor, RowMajor)
RANGECAL_EIGEN_PRODUCT(RowMajor, ColMajor)
RANGECAL_EIGEN_PRODUCT(RowMajor, RowMajor)
#undef RANGECAL_EIGEN_PRODUCT
RANGECAL_EIGEN struct selfadjoint_matrix_vector_product<double, Index, ColMajor, Lower, false, false>;

// solutions with triangles
#define RANGECAL_EIGEN_TRIANGLE(mode)                                                                      \
  RANGECAL_EIGEN struct triangular_solve_matrix<double, Index, OnTheLeft, mode, false, ColMajor, ColMajor, \
                                                1>;                                                        \
  RANGECAL_EIGEN struct triangular_solve_matrix<double, Index, OnTheLeft, mode, false, RowMajor, ColMajor, \
                                                1>;                                                        \
  RANGECAL_EIGEN struct triangular_solve_vector<double, double, Index, OnTheLeft, mode, false, ColMajor>;  \
  RANGECAL_EIGEN struct triangular_solve_vector<double, double, Index, OnTheLeft, mode, false, RowMajor>;
RANGECAL_EIGEN_TRIANGLE(Lower)
RANGECAL_EIGEN_TRIANGLE(Upper)
RANGECAL_EIGEN_TRIANGLE(UnitLower)
RANGECAL_EIGEN_TRIANGLE(UnitUpper)
#undef RANGECAL_EIGEN_TRIANGLE
RANGECAL_EIGEN struct triangular_solve_matrix<double, Index, OnTheRight, Upper, false, RowMajor, ColMajor, 1>;

}  // namespace internal
}  // namespace Eigen
#endif

#undef RANGECAL_EIGEN
