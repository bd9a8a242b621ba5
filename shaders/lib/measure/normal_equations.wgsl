// Normal equations of one subset in a thread's own memory.
// The NumPy form is gpusim/measure/correlation/icgn.py.

const MIN_PIVOT = 1e-5;

override unknowns: u32;

var<private> factor: array<f32, 144>; // rows of 12; first the matrix, then its Cholesky factor
var<private> step: array<f32, 12>;    // right side, then solution

// Cholesky factor in place; false where a motion can't be told from the grey values.
fn factorize() -> bool {
    var largest = 0.0;
    for (var i = 0u; i < unknowns; i++) {
        largest = max(largest, factor[i * 12u + i]);
    }
    for (var j = 0u; j < unknowns; j++) {
        let diagonal = factor[j * 12u + j];
        var pivot = diagonal;
        for (var k = 0u; k < j; k++) {
            pivot -= factor[j * 12u + k] * factor[j * 12u + k];
        }
        if (!(pivot > MIN_PIVOT * diagonal && diagonal > MIN_PIVOT * MIN_PIVOT * largest)) {
            return false;
        }
        let root = sqrt(pivot);
        factor[j * 12u + j] = root;
        for (var i = j + 1u; i < unknowns; i++) {
            var value = factor[i * 12u + j];
            for (var k = 0u; k < j; k++) {
                value -= factor[i * 12u + k] * factor[j * 12u + k];
            }
            factor[i * 12u + j] = value / root;
        }
    }
    return true;
}

// Solve L L^T x = step, in place.
fn solve() {
    for (var i = 0u; i < unknowns; i++) {
        var value = step[i];
        for (var k = 0u; k < i; k++) {
            value -= factor[i * 12u + k] * step[k];
        }
        step[i] = value / factor[i * 12u + i];
    }
    for (var n = 0u; n < unknowns; n++) {
        let i = unknowns - 1u - n;
        var value = step[i];
        for (var k = i + 1u; k < unknowns; k++) {
            value -= factor[k * 12u + i] * step[k];
        }
        step[i] = value / factor[i * 12u + i];
    }
}

// Diagonal entry of the inverse of the matrix.
fn variance(index: u32) -> f32 {
    for (var i = 0u; i < unknowns; i++) {
        step[i] = select(0.0, 1.0, i == index);
    }
    solve();
    return step[index];
}
