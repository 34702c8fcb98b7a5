
/* a + b and a - b, rounded as IEEE 754 says. libgcc (ieee754-df.S; 12.2 was tried) rounds wrongly where a power of two
   meets a number of the other sign whose exponent is 33 less: of what it shifts out it keeps one bit, and the result,
   shorter by a bit, needs two. There b is added in two parts, the first of them exactly. */
double ortilo_sum(double a, double b);
double ortilo_difference(double a, double b);

static uint64_t bits_of(double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static double two_sums(double power, double small) {
    uint64_t upper = bits_of(small) & ~UINT64_C(0xffffffff);
    double first;
    memcpy(&first, &upper, sizeof first);
    return (power + first) + (small - first);
}

static int meets_33_below(uint64_t power, uint64_t small) {
    const uint64_t exponent = small << 1 >> 53;
    return power << 12 == 0 && (power << 1 >> 53) - (exponent ? exponent : 1) == 33;
}

double ortilo_sum(double a, double b) {
    const uint64_t x = bits_of(a), y = bits_of(b);
    if ((x ^ y) >> 63 != 0) {
        if (meets_33_below(x, y)) return two_sums(a, b);
        if (meets_33_below(y, x)) return two_sums(b, a);
    }
    return a + b;
}

double ortilo_difference(double a, double b) { return ortilo_sum(a, -b); }
