/* FIR filter with decimation: out[k] = sum over i < taps of kernel[i] x[k factor + i], for k < count.
 * Eight lanes, so that the sum has one order whatever the width of the processor's vectors. */
void tendon_decimate_f64(
    size_t count,
    size_t factor,
    size_t taps,
    const double *restrict kernel,
    const double *restrict x,
    double *restrict out)
{
    for (size_t k = 0; k < count; ++k) {
        const double *restrict window = x + k * factor;
        double lane[8] = {0};
        double rest = 0;
        size_t i = 0;
        for (; i + 8 <= taps; i += 8) {
            for (size_t j = 0; j < 8; ++j) {
                lane[j] += window[i + j] * kernel[i + j];
            }
        }
        for (; i < taps; ++i) {
            rest += window[i] * kernel[i];
        }
        out[k] = ((lane[0] + lane[4]) + (lane[1] + lane[5])) + ((lane[2] + lane[6]) + (lane[3] + lane[7])) + rest;
    }
}

/* The same of the first `filled` of 8 columns, x (..., 8), each into a row of `out`; the rows begin `apart` from
 *   each other. */
void tendon_decimate_at_once_f64(
    size_t count,
    size_t filled,
    size_t apart,
    size_t factor,
    size_t taps,
    const double *restrict kernel,
    const double *restrict x,
    double *restrict out)
{
    const size_t whole = taps - taps % 8;
    size_t near = 0;
    for (size_t k = 0; k < count; k += near) {
        const double *restrict window = x + 8 * factor * k;
        double sum[4][8][8] = {{{0}}};
        near = (whole > 3 * factor && k + 4 <= count) ? 4 : 1;
        for (size_t i = 0; near == 1 && i < whole; ++i) {
            for (size_t j = 0; j < 8; ++j) { sum[0][i % 8][j] += window[8 * i + j] * kernel[i]; }
        }
        for (size_t part = 0; near > 1 && part < 8; ++part) {
            double lane0[8] = {0}, lane1[8] = {0}, lane2[8] = {0}, lane3[8] = {0};
            size_t i = part;
            for (; i < 3 * factor; i += 8) {
                const double *restrict sample = window + 8 * i;
                for (size_t j = 0; j < 8; ++j) { lane0[j] += sample[j] * kernel[i]; }
                if (i >= 1 * factor) for (size_t j = 0; j < 8; ++j) { lane1[j] += sample[j] * kernel[i - 1 *
        factor]; }
                if (i >= 2 * factor) for (size_t j = 0; j < 8; ++j) { lane2[j] += sample[j] * kernel[i - 2 *
        factor]; }
            }
            for (; i < whole; i += 8) {
                const double *restrict sample = window + 8 * i;
                for (size_t j = 0; j < 8; ++j) { lane0[j] += sample[j] * kernel[i]; }
                for (size_t j = 0; j < 8; ++j) { lane1[j] += sample[j] * kernel[i - 1 * factor]; }
                for (size_t j = 0; j < 8; ++j) { lane2[j] += sample[j] * kernel[i - 2 * factor]; }
                for (size_t j = 0; j < 8; ++j) { lane3[j] += sample[j] * kernel[i - 3 * factor]; }
            }
            for (; i < whole + 3 * factor; i += 8) {
                const double *restrict sample = window + 8 * i;
                if (i < whole + 1 * factor) for (size_t j = 0; j < 8; ++j) { lane1[j] += sample[j] * kernel[i - 1 *
        factor]; }
                if (i < whole + 2 * factor) for (size_t j = 0; j < 8; ++j) { lane2[j] += sample[j] * kernel[i - 2 *
        factor]; }
                for (size_t j = 0; j < 8; ++j) { lane3[j] += sample[j] * kernel[i - 3 * factor]; }
            }
            for (size_t j = 0; j < 8; ++j) {
                sum[0][(part + 0 * factor) % 8][j] = lane0[j];
                sum[1][(part + 7 * factor) % 8][j] = lane1[j];
                sum[2][(part + 14 * factor) % 8][j] = lane2[j];
                sum[3][(part + 21 * factor) % 8][j] = lane3[j];
            }
        }
        for (size_t m = 0; m < near; ++m) {
            double rest[8] = {0};
            for (size_t i = whole; i < taps; ++i) {
                for (size_t j = 0; j < 8; ++j) { rest[j] += window[8 * (i + m * factor) + j] * kernel[i]; }
            }
            for (size_t j = 0; j < filled; ++j) {
                out[j * apart + k + m] = ((sum[m][0][j] + sum[m][4][j]) + (sum[m][1][j] + sum[m][5][j])) +
                    ((sum[m][2][j] + sum[m][6][j]) + (sum[m][3][j] + sum[m][7][j])) + rest[j];
            }
        }
    }
}

/* Columns of `choices` choices of `width` parameters, p (choices, width) filled up to whole lanes, filtered and
 *   decimated: out (choices, rows, kept).
 * lanes: choices that `columns` takes at once; rows: of all joints; scratch (rows, count, lanes). */
void tendon_in_band_f64(
    tendon_columns_f64 *columns,
    size_t lanes,
    size_t rows,
    size_t width,
    size_t choices,
    size_t count,
    size_t joints,
    const tendon_signals_f64 *s,
    double dt,
    const double *restrict p,
    size_t factor,
    size_t taps,
    const double *restrict kernel,
    double *restrict scratch,
    double *restrict out)
{
    const size_t kept = (count < taps) ? 0U : (count - taps) / factor + 1U;
    for (size_t first = 0; first < choices; first += lanes) {
        const size_t filled = (choices - first < lanes) ? choices - first : lanes;
        columns(count, joints, s, dt, p + first * width, scratch);
        for (size_t i = 0; i < rows; ++i) {
            const double *x = scratch + i * count * lanes;
            double *target = out + (first * rows + i) * kept;
            size_t k = 0;
            while (k < count * lanes && x[k] == 0) {
                ++k;
            }
            if (k == count * lanes) {
                for (k = 0; k < filled * kept; ++k) {
                    target[k / kept * rows * kept + k % kept] = 0;
                }
            } else if (lanes == 1U) {
                tendon_decimate_f64(kept, factor, taps, kernel, x, target);
            } else {
                tendon_decimate_at_once_f64(kept, filled, rows * kept, factor, taps, kernel, x, target);
            }
        }
    }
}
