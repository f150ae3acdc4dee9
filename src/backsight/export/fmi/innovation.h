/* How surprising a sample is. Part of fmu.c. */
/* Normalised innovation squared e' S^-1 e of the outputs that were seen; NaN without any.
 * S is a lower triangle, column by column. It is brought to unit diagonal and factored by Cholesky. */
static double nis(const double *e, const double *S, const bool *seen)
{
    double L[MODEL_NY + 1][MODEL_NY + 1], z[MODEL_NY + 1], size[MODEL_NY + 1], sum = 0.0;
    int which[MODEL_NY + 1], n = 0, i, j, k;
    for (i = 0; i < MODEL_NY; ++i)
        if (seen[i])
            which[n++] = i;
    for (i = 0; i < n; ++i) {
        const int row = which[i];
        const double variance = S[row * MODEL_NY - row * (row - 1) / 2];
        if (!(variance > 0.0) || !isfinite(variance))
            return NAN;
        size[i] = sqrt(variance);
        z[i] = e[row] / size[i];
        for (j = 0; j <= i; ++j) {
            const int column = which[j];
            double rest = S[column * MODEL_NY - column * (column - 1) / 2 + (row - column)];
            rest = rest / size[i] / size[j];
            for (k = 0; k < j; ++k)
                rest -= L[i][k] * L[j][k];
            if (j < i) {
                L[i][j] = rest / L[j][j];
                z[i] -= L[i][j] * z[j];
            } else {
                if (!(rest > 0.0) || !isfinite(rest))
                    return NAN;
                L[i][i] = sqrt(rest);
                z[i] /= L[i][i];
            }
        }
        sum += z[i] * z[i];
    }
    return n > 0 ? sum : NAN;
}
