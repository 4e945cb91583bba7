// Eigenvalues of a real matrix of 16 rows.
//
// Householder reflections reduce the matrix to Hessenberg form, and Francis's QR iteration with double shifts finds the
// eigenvalues (Francis 1961, "The QR transformation"; Golub and Van Loan, "Matrix Computations", 7.4 and 7.5). The
// eigenvalues are those of a matrix that differs from the given one by a small multiple of the rounding unit times its
// norm. Eigenvectors and condition numbers follow from inverse iteration on the Hessenberg form.
#pragma once

namespace pinproof {

inline constexpr int kEigenRows = 16;

using EigenMatrix = double[kEigenRows][kEigenRows];

struct Eigenvalue {
    double real, imaginary;
};

class HessenbergForm {
  public:
    // Reduce a matrix of finite numbers.
    void reduce(const EigenMatrix& matrix);

    // All eigenvalues; complex ones in adjacent pairs. Returns false if the iteration does not converge.
    bool eigenvalues(Eigenvalue (&values)[kEigenRows]) const;

    // A unit eigenvector of the given matrix for a real eigenvalue.
    void eigenvector(double value, double (&vector)[kEigenRows]) const;

    // The condition number |x| |y| / |y^H x| of an eigenvalue with the eigenvectors x and y of both sides: a change of
    // the matrix by a small E moves the eigenvalue by at most this multiple of |E| (Wilkinson 1965, "The Algebraic
    // Eigenvalue Problem", 2.8).
    double condition(const Eigenvalue& value) const;

    // The Frobenius norm of the matrix.
    double norm() const;

  private:
    EigenMatrix h_;                               // the Hessenberg form
    EigenMatrix reflector_;                       // row k: the vector of reflection k
};

}  // namespace pinproof
