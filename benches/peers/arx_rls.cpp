// Recursive least squares as flight controllers write it: fixed sizes, single precision, one
// output; on the rows of rows.csv.
//
//   K = P phi / (lambda + phi' P phi),   theta += K (y - phi' theta),   P = (P - K phi' P) / lambda
//
// L. Ljung, System Identification, 2nd ed. 1999, (11.12); K. J. Astrom, B. Wittenmark, Adaptive
// Control, 2nd ed. 1995, theorem 2.4. PX4 has this form in its ArxRls, whose regressors are past
// inputs and outputs; here they are the rows of the arm, so that the job is the same.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

template <typename Real, std::size_t N>
class Rls {
public:
    Rls(Real lambda, Real start_variance) : lambda_(lambda) {
        for (std::size_t i = 0; i < N; ++i) {
            covariance_[i][i] = start_variance;
        }
    }

    void update(const std::array<Real, N> &phi, Real y) {
        std::array<Real, N> p_phi{};
        Real s = lambda_, error = y;
        for (std::size_t i = 0; i < N; ++i) {
            for (std::size_t j = 0; j < N; ++j) {
                p_phi[i] += covariance_[i][j] * phi[j];
            }
            s += phi[i] * p_phi[i];
            error -= phi[i] * theta_[i];
        }
        for (std::size_t i = 0; i < N; ++i) {
            theta_[i] += p_phi[i] * error / s;
            for (std::size_t j = 0; j < N; ++j) {
                covariance_[i][j] = (covariance_[i][j] - p_phi[i] * p_phi[j] / s) / lambda_;
            }
        }
    }

    const std::array<Real, N> &theta() const { return theta_; }

private:
    Real lambda_;
    std::array<Real, N> theta_{};
    std::array<std::array<Real, N>, N> covariance_{};
};

// Variance of each parameter at the start, its unit squared; theta starts from 0.
static const double kStartVariance = 10;
// The parameters that the motion tells to 1 %: theta_2, theta_5, theta_7, theta_8, theta_9.
static const std::array<std::size_t, 5> kTold = {1, 4, 6, 7, 8};

using Table = std::vector<std::vector<double>>;

static Table read(const std::string &name) {
    std::ifstream file(name);
    Table rows;
    std::string line;
    std::getline(file, line);
    while (std::getline(file, line)) {
        std::vector<double> row;
        std::stringstream fields(line);
        for (std::string field; std::getline(fields, field, ',');) {
            row.push_back(std::stod(field));
        }
        rows.push_back(row);
    }
    return rows;
}

template <typename Real>
static void run(const char *name, const Table &rows, const Table &truth) {
    std::vector<std::array<Real, 5>> a(rows.size()), b(rows.size());
    std::vector<Real> y(rows.size()), z(rows.size());
    for (std::size_t k = 0; k < rows.size(); ++k) {
        for (std::size_t i = 0; i < 5; ++i) {
            a[k][i] = Real(rows[k][i]);
            b[k][i] = Real(rows[k][6 + i]);
        }
        y[k] = Real(rows[k][5]);
        z[k] = Real(rows[k][11]);
    }
    double best = 1e300;
    std::array<double, 9> theta{};
    for (int repetition = 0; repetition < 5; ++repetition) {
        const auto start = std::chrono::steady_clock::now();
        Rls<Real, 5> one(1, Real(kStartVariance)), two(1, Real(kStartVariance));
        for (std::size_t k = 0; k < rows.size(); ++k) {
            one.update(a[k], y[k]);
            two.update(b[k], z[k]);
        }
        const auto &t = one.theta();
        const auto &u = two.theta();
        for (std::size_t i = 0; i < 5; ++i) {
            theta[i] = double(t[i]);
        }
        for (std::size_t i = 0; i < 3; ++i) {
            theta[5 + i] = double(u[i]);
        }
        theta[8] = double(u[4] / u[1]);
        best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    std::array<double, kTold.size()> errors{};
    for (std::size_t i = 0; i < errors.size(); ++i) {
        errors[i] = std::fabs(theta[kTold[i]] / truth[kTold[i]][0] - 1);
    }
    // a NaN counts as the worst
    std::sort(errors.begin(), errors.end(), [](double x, double y) { return std::isnan(y) ? !std::isnan(x) : x < y; });
    const double each_ns = best / double(rows.size()) * 1e9;
    std::printf("rows,%s,%zu,%.4f,%.4e,%.4e\n", name, rows.size(), each_ns, errors.back(), errors[errors.size() / 2]);
}

int main(int count, char **arguments) {
    if (count != 2) {
        std::fprintf(stderr, "expected the folder of the data as the one argument\n");
        return 2;
    }
    const std::string folder = arguments[1];
    const auto rows = read(folder + "/rows.csv");
    const auto truth = read(folder + "/truth.csv");
    if (rows.empty() || truth.size() != 9) {
        std::fprintf(stderr, "%s: expected rows.csv and truth.csv as thetabus-peers writes them\n", folder.c_str());
        return 1;
    }
    run<float>("C++ RLS in PX4's form f32", rows, truth);
    run<double>("C++ RLS in PX4's form f64", rows, truth);
}
