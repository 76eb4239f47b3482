//! What the functions of a file call, as static functions of that file.

/// The helpers with the prefix of their names. The algorithms and their errors are those of `dynid-generated`
/// (`lanes/trigonometry.rs`, `lanes/exponential.rs`): below 1 unit in the last place.
pub fn runtime(prefix: &str) -> String {
    TEXT.replace("PREFIX", prefix)
}

const TEXT: &str = r"/* --- Sines, cosines, exponentials and choices. ------------------------------------------------------------ */

typedef union { double number; uint64_t bits; } PREFIX_word;

/* Sine and cosine of an angle (rad). The reduction subtracts multiples of pi/2 in three parts (Cody & Waite 1980); the rest goes
 * into minimax polynomials. Nothing branches on the angle, up to 1e6 rad. */
static inline void PREFIX_sine_cosine(double angle, double *sine, double *cosine)
{
    if (!(fabs(angle) <= 1.0e6)) {
        *sine = sin(angle);
        *cosine = cos(angle);
        return;
    }
    /* Adding and subtracting 1.5 * 2^52 rounds to an integer, which the low bits of the sum then hold. */
    PREFIX_word shifted, s, c;
    shifted.number = angle * 0.6366197723675814 + 6755399441055744.0;
    const double k = shifted.number - 6755399441055744.0;
    const double first = angle - k * 1.5707963267341256;
    const double product = k * 6.077100506303966e-11;
    const double second = first - product;
    const double rest = ((first - second) - product) - k * 2.0222662487959506e-21;
    const double r = second + rest;
    const double low = (second - r) + rest;

    const double z = r * r;
    const double z2 = z * z;
    const double odd = (-0.16666666666666632 + z * 0.008333333333322418)
        + z2 * ((-0.00019841269829812394 + z * 2.7557313693577104e-06)
            + z2 * (-2.505075838497598e-08 + z * 1.589681182908179e-10));
    const double half = 0.5 * z;
    const double near_one = 1.0 - half;
    s.number = r + (z * r * odd + low * near_one);
    const double even = (0.041666666666666595 + z * -0.001388888888887305)
        + z2 * ((2.4801587288846537e-05 + z * -2.755731417776405e-07)
            + z2 * (2.0875700628463847e-09 + z * -1.1358525208068056e-11));
    c.number = near_one + (((1.0 - near_one) - half) + (z2 * even - r * low));

    /* The quadrant swaps the two and sets their signs. */
    const uint64_t swap = (uint64_t)0 - (shifted.bits & 1);
    const uint64_t difference = (s.bits ^ c.bits) & swap;
    s.bits = (s.bits ^ difference) ^ ((shifted.bits & 2) << 62);
    c.bits = (c.bits ^ difference) ^ (((shifted.bits + 1) & 2) << 62);
    *sine = s.number;
    *cosine = c.number;
}

static inline double PREFIX_sine(double angle)
{
    double sine, cosine;
    PREFIX_sine_cosine(angle, &sine, &cosine);
    return sine;
}

static inline double PREFIX_cosine(double angle)
{
    double sine, cosine;
    PREFIX_sine_cosine(angle, &sine, &cosine);
    return cosine;
}

/* e^x: multiples of ln 2 in two parts, then a minimax polynomial; the factor 2^k is applied in two halves. */
static inline double PREFIX_exponential(double argument)
{
    if (argument < -746.0) {
        return 0.0;
    }
    const double x = argument > 710.0 ? 710.0 : argument;
    PREFIX_word shifted, power, other;
    shifted.number = x * 1.4426950408889634 + 6755399441055744.0;
    const double k = shifted.number - 6755399441055744.0;
    const double high = x - k * 0.693147180559663;
    const double product = k * 2.8235290563031577e-13;
    const double r = high - product;
    const double low = (high - r) - product;

    const double z = r * r;
    const double z2 = z * z;
    const double first = (0.5000000000000011 + r * 0.1666666666666641) + z * (0.041666666666529725 + r * 0.008333333333494976);
    const double second = (0.0013888888943759965 + r * 0.00019841269505773776)
        + z * (2.480149294963387e-05 + r * 2.7557586803895326e-06);
    const double tail = first + z2 * (second + z2 * (2.76303062502936e-07 + r * 2.5000018833187374e-08));
    const double value = 1.0 + (r + (z * tail + low * (1.0 + r)));

    const uint64_t integer = shifted.bits - ((uint64_t)0x4338000000000000 - 2048);
    const uint64_t part = integer >> 1;
    power.bits = (part - 1) << 52;
    other.bits = ((integer - part) - 1) << 52;
    return value * power.number * other.number;
}

/* -1, 0 or 1; keeps a NaN. */
static inline double PREFIX_sign(double x)
{
    return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x * 0.0;
}

static inline double PREFIX_minimum(double a, double b)
{
    return a < b ? a : b;
}

static inline double PREFIX_maximum(double a, double b)
{
    return b < a ? a : b;
}
";
