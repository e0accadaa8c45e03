// SPDX-License-Identifier: Apache-2.0
// Median of nine values by minima and maxima alone: that of the largest minimum, the middle median and the smallest maximum of three sorted triples.
#ifndef GOBO_EXAMPLE_MEDIAN
#define GOBO_EXAMPLE_MEDIAN
#include "formulas/formulas.h"
FORMULAS_BEGIN

FORMULA float leastOf3(float a, float b, float c) { return minOf(minOf(a, b), c); }
FORMULA float mostOf3(float a, float b, float c) { return maxOf(maxOf(a, b), c); }
FORMULA float medianOf3(float a, float b, float c) { return maxOf(minOf(a, b), minOf(maxOf(a, b), c)); }

FORMULA float medianOf9(float a, float b, float c, float d, float e, float f, float g, float h, float i) {
  return medianOf3(mostOf3(leastOf3(a, b, c), leastOf3(d, e, f), leastOf3(g, h, i)), medianOf3(medianOf3(a, b, c), medianOf3(d, e, f), medianOf3(g, h, i)),
                   leastOf3(mostOf3(a, b, c), mostOf3(d, e, f), mostOf3(g, h, i)));
}

FORMULAS_END
#endif
