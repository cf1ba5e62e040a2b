#ifndef LANES_H
#define LANES_H
#include "config.h"

/* Four members at a time: a lanes_xyz holds x, y, z of one node, a lanes_four one value of each of four members, a
 * lanes_pack as many of these as one register. Every operation rounds as that on single numbers, so results do not
 * depend on the registers. LANES_PART is the pack that begins with member k; LANES_FOUR and LANES_TOTAL join and add
 * up what `of`, a macro, gives for all packs. The kernels of members are generated behind this. */
#if defined(__GNUC__)
#define LANES_INLINE __attribute__((always_inline, unused)) static inline
#else
#define LANES_INLINE static
#endif
#if defined(__GNUC__) && !defined(TENSEGRITY_NO_LANES) && (defined(__AVX2__) || defined(__SSE2__))
#define TENSEGRITY_LANES 1
#if defined(__AVX2__)
#include <immintrin.h>
typedef __m256d lanes_pack;
typedef __m256d lanes_xyz;
typedef __m256d lanes_four;
#if WITH_BLOCKS
typedef struct { __m128d xy, z; } lanes_column;
#endif
#define LANES_PART(four, k) (four)
#define LANES_FOUR(of) of(0)
#define LANES_TOTAL(of) of(0)
#define LANES_XYZ _mm256_set_epi64x(0, -1, -1, -1)

LANES_INLINE lanes_pack pack_all(double value) { return _mm256_set1_pd(value); }
LANES_INLINE void pack_store(double *four, lanes_pack a) { _mm256_storeu_pd(four, a); }
LANES_INLINE lanes_pack pack_absolute(lanes_pack a) { return _mm256_andnot_pd(_mm256_set1_pd(-0.0), a); }
LANES_INLINE int pack_is_below(lanes_pack a, double limit)
{
  return _mm256_movemask_pd(_mm256_cmp_pd(a, _mm256_set1_pd(limit), _CMP_LT_OQ)) == 15;
}
#if WITH_BLOCKS
LANES_INLINE double pack_sum(lanes_pack a)
{
  double four[4];
  pack_store(four, a);
  return four[0] + four[1] + (four[2] + four[3]);
}
#endif
LANES_INLINE lanes_pack pack_sqrt(lanes_pack a) { return _mm256_sqrt_pd(a); }
LANES_INLINE lanes_pack pack_less(lanes_pack a, lanes_pack b) { return _mm256_cmp_pd(a, b, _CMP_LT_OQ); }
LANES_INLINE lanes_pack pack_and(lanes_pack a, lanes_pack b) { return _mm256_and_pd(a, b); }
LANES_INLINE lanes_pack pack_or(lanes_pack a, lanes_pack b) { return _mm256_or_pd(a, b); }

LANES_INLINE lanes_xyz xyz_load(const double *xyz) { return _mm256_loadu_pd(xyz); }
LANES_INLINE lanes_xyz xyz_load_last(const double *xyz) { return _mm256_maskload_pd(xyz, LANES_XYZ); }
LANES_INLINE lanes_xyz xyz_of(double x, double y, double z) { return _mm256_set_pd(0.0, z, y, x); }
LANES_INLINE lanes_xyz xyz_minus(lanes_xyz a, lanes_xyz b) { return _mm256_sub_pd(a, b); }
LANES_INLINE lanes_xyz xyz_plus(lanes_xyz a, lanes_xyz b) { return _mm256_add_pd(a, b); }
LANES_INLINE void xyz_store(double *xyz, lanes_xyz a) { _mm256_storeu_pd(xyz, a); }
LANES_INLINE void xyz_store_last(double *xyz, lanes_xyz a)
{
  _mm_storeu_pd(xyz, _mm256_castpd256_pd128(a));
  _mm_store_sd(xyz + 2, _mm256_extractf128_pd(a, 1));
}
LANES_INLINE lanes_four four_load(const double *values) { return _mm256_loadu_pd(values); }
LANES_INLINE lanes_four four_of(double a, double b, double c, double d) { return _mm256_set_pd(d, c, b, a); }

LANES_INLINE void four_split(
    lanes_xyz a, lanes_xyz b, lanes_xyz c, lanes_xyz d, lanes_four *x, lanes_four *y, lanes_four *z)
{
  const __m256d xz_ab = _mm256_unpacklo_pd(a, b), xz_cd = _mm256_unpacklo_pd(c, d);
  const __m256d y_ab = _mm256_unpackhi_pd(a, b), y_cd = _mm256_unpackhi_pd(c, d);
  *x = _mm256_insertf128_pd(xz_ab, _mm256_castpd256_pd128(xz_cd), 1);
  *y = _mm256_insertf128_pd(y_ab, _mm256_castpd256_pd128(y_cd), 1);
  *z = _mm256_permute2f128_pd(xz_ab, xz_cd, 0x31);
}

LANES_INLINE lanes_xyz xyz_negative(lanes_xyz a) { return _mm256_xor_pd(a, _mm256_set1_pd(-0.0)); }

/* The vectors of four members, whose components stand in x, y and z. */
LANES_INLINE void four_join_xyz(lanes_four x, lanes_four y, lanes_four z, lanes_xyz *four)
{
  const __m256d xy_ac = _mm256_unpacklo_pd(x, y), xy_bd = _mm256_unpackhi_pd(x, y);
  const __m256d z_ac = _mm256_unpacklo_pd(z, z), z_bd = _mm256_unpackhi_pd(z, z);
  four[0] = _mm256_permute2f128_pd(xy_ac, z_ac, 0x20);
  four[1] = _mm256_permute2f128_pd(xy_bd, z_bd, 0x20);
  four[2] = _mm256_permute2f128_pd(xy_ac, z_ac, 0x31);
  four[3] = _mm256_permute2f128_pd(xy_bd, z_bd, 0x31);
}

#if WITH_LOOPS
LANES_INLINE void xyz_add(double *xyz, lanes_xyz a)
{
  _mm_storeu_pd(xyz, _mm_add_pd(_mm_loadu_pd(xyz), _mm256_castpd256_pd128(a)));
  _mm_store_sd(xyz + 2, _mm_add_sd(_mm_load_sd(xyz + 2), _mm256_extractf128_pd(a, 1)));
}

LANES_INLINE void xyz_subtract(double *xyz, lanes_xyz a)
{
  _mm_storeu_pd(xyz, _mm_sub_pd(_mm_loadu_pd(xyz), _mm256_castpd256_pd128(a)));
  _mm_store_sd(xyz + 2, _mm_sub_sd(_mm_load_sd(xyz + 2), _mm256_extractf128_pd(a, 1)));
}
#endif

LANES_INLINE int xyz_is_zero(lanes_xyz a)
{
  return (_mm256_movemask_pd(_mm256_cmp_pd(a, _mm256_setzero_pd(), _CMP_EQ_OQ)) & 7) == 7;
}

#if WITH_BLOCKS
/* Three entries of each of four members, four apart in memory, to one column a member. */
LANES_INLINE void four_columns(const double *x, const double *y, const double *z, lanes_column *column)
{
  const __m256d a = _mm256_loadu_pd(x), b = _mm256_loadu_pd(y), c = _mm256_loadu_pd(z);
  const __m256d even = _mm256_unpacklo_pd(a, b), odd = _mm256_unpackhi_pd(a, b);
  const __m128d low = _mm256_castpd256_pd128(c), high = _mm256_extractf128_pd(c, 1);
  column[0].xy = _mm256_castpd256_pd128(even);
  column[0].z = low;
  column[1].xy = _mm256_castpd256_pd128(odd);
  column[1].z = _mm_unpackhi_pd(low, low);
  column[2].xy = _mm256_extractf128_pd(even, 1);
  column[2].z = high;
  column[3].xy = _mm256_extractf128_pd(odd, 1);
  column[3].z = _mm_unpackhi_pd(high, high);
}
#endif

#define XYZ_TIMES(four, k, node) _mm256_mul_pd(_mm256_permute4x64_pd(four, 0x55 * (k)), node)
#define XYZ_ONLY(node, axes) _mm256_blend_pd(_mm256_setzero_pd(), node, axes)
#else
#include <emmintrin.h>
typedef __m128d lanes_pack;
typedef struct { __m128d xy, z; } lanes_xyz;
#if WITH_BLOCKS
typedef lanes_xyz lanes_column;
#endif
typedef struct { __m128d low, high; } lanes_four;
#define LANES_PART(four, k) ((k) < 2 ? (four).low : (four).high)
#define LANES_FOUR(of) four_join(of(0), of(2))
#define LANES_TOTAL(of) (of(0) + of(2))

LANES_INLINE lanes_pack pack_all(double value) { return _mm_set1_pd(value); }
LANES_INLINE void pack_store(double *four, lanes_pack a) { _mm_storeu_pd(four, a); }
LANES_INLINE lanes_pack pack_absolute(lanes_pack a) { return _mm_andnot_pd(_mm_set1_pd(-0.0), a); }
LANES_INLINE int pack_is_below(lanes_pack a, double limit)
{
  return _mm_movemask_pd(_mm_cmplt_pd(a, _mm_set1_pd(limit))) == 3;
}
#if WITH_BLOCKS
LANES_INLINE double pack_sum(lanes_pack a) { return _mm_cvtsd_f64(_mm_add_sd(a, _mm_unpackhi_pd(a, a))); }
#endif
LANES_INLINE lanes_pack pack_sqrt(lanes_pack a) { return _mm_sqrt_pd(a); }
LANES_INLINE lanes_pack pack_less(lanes_pack a, lanes_pack b) { return _mm_cmplt_pd(a, b); }
LANES_INLINE lanes_pack pack_and(lanes_pack a, lanes_pack b) { return _mm_and_pd(a, b); }
LANES_INLINE lanes_pack pack_or(lanes_pack a, lanes_pack b) { return _mm_or_pd(a, b); }

LANES_INLINE lanes_xyz xyz_join(__m128d xy, __m128d z)
{
  lanes_xyz node;
  node.xy = xy;
  node.z = z;
  return node;
}

LANES_INLINE lanes_four four_join(__m128d low, __m128d high)
{
  lanes_four four;
  four.low = low;
  four.high = high;
  return four;
}

LANES_INLINE lanes_xyz xyz_load(const double *xyz) { return xyz_join(_mm_loadu_pd(xyz), _mm_load_sd(xyz + 2)); }
LANES_INLINE lanes_xyz xyz_load_last(const double *xyz) { return xyz_load(xyz); }
LANES_INLINE lanes_xyz xyz_of(double x, double y, double z) { return xyz_join(_mm_set_pd(y, x), _mm_set_sd(z)); }
LANES_INLINE lanes_xyz xyz_minus(lanes_xyz a, lanes_xyz b)
{
  return xyz_join(_mm_sub_pd(a.xy, b.xy), _mm_sub_sd(a.z, b.z));
}
LANES_INLINE lanes_xyz xyz_plus(lanes_xyz a, lanes_xyz b)
{
  return xyz_join(_mm_add_pd(a.xy, b.xy), _mm_add_sd(a.z, b.z));
}
LANES_INLINE void xyz_store(double *xyz, lanes_xyz a)
{
  _mm_storeu_pd(xyz, a.xy);
  _mm_store_sd(xyz + 2, a.z);
}
LANES_INLINE void xyz_store_last(double *xyz, lanes_xyz a) { xyz_store(xyz, a); }
LANES_INLINE lanes_four four_load(const double *values)
{
  return four_join(_mm_loadu_pd(values), _mm_loadu_pd(values + 2));
}
LANES_INLINE lanes_four four_of(double a, double b, double c, double d)
{
  return four_join(_mm_set_pd(b, a), _mm_set_pd(d, c));
}

LANES_INLINE void four_split(
    lanes_xyz a, lanes_xyz b, lanes_xyz c, lanes_xyz d, lanes_four *x, lanes_four *y, lanes_four *z)
{
  *x = four_join(_mm_unpacklo_pd(a.xy, b.xy), _mm_unpacklo_pd(c.xy, d.xy));
  *y = four_join(_mm_unpackhi_pd(a.xy, b.xy), _mm_unpackhi_pd(c.xy, d.xy));
  *z = four_join(_mm_unpacklo_pd(a.z, b.z), _mm_unpacklo_pd(c.z, d.z));
}

LANES_INLINE lanes_xyz xyz_negative(lanes_xyz a)
{
  const __m128d sign = _mm_set1_pd(-0.0);
  return xyz_join(_mm_xor_pd(a.xy, sign), _mm_xor_pd(a.z, sign));
}

/* The vectors of four members, whose components stand in x, y and z. */
LANES_INLINE void four_join_xyz(lanes_four x, lanes_four y, lanes_four z, lanes_xyz *four)
{
  four[0] = xyz_join(_mm_unpacklo_pd(x.low, y.low), z.low);
  four[1] = xyz_join(_mm_unpackhi_pd(x.low, y.low), _mm_unpackhi_pd(z.low, z.low));
  four[2] = xyz_join(_mm_unpacklo_pd(x.high, y.high), z.high);
  four[3] = xyz_join(_mm_unpackhi_pd(x.high, y.high), _mm_unpackhi_pd(z.high, z.high));
}

#if WITH_LOOPS
LANES_INLINE void xyz_add(double *xyz, lanes_xyz a) { xyz_store(xyz, xyz_plus(xyz_load(xyz), a)); }
LANES_INLINE void xyz_subtract(double *xyz, lanes_xyz a) { xyz_store(xyz, xyz_minus(xyz_load(xyz), a)); }
#endif

LANES_INLINE int xyz_is_zero(lanes_xyz a)
{
  const __m128d zero = _mm_setzero_pd();
  return _mm_movemask_pd(_mm_and_pd(_mm_cmpeq_pd(a.xy, zero), _mm_cmpeq_pd(_mm_unpacklo_pd(a.z, a.z), zero))) == 3;
}

LANES_INLINE lanes_xyz xyz_only(lanes_xyz a, int axes)
{
  const __m128i xy = _mm_set_epi64x((axes & 2) ? -1 : 0, (axes & 1) ? -1 : 0);
  return xyz_join(_mm_and_pd(a.xy, _mm_castsi128_pd(xy)), (axes & 4) ? a.z : _mm_setzero_pd());
}

LANES_INLINE lanes_xyz xyz_scaled(__m128d twice, lanes_xyz a)
{
  return xyz_join(_mm_mul_pd(twice, a.xy), _mm_mul_sd(twice, a.z));
}

#if WITH_BLOCKS
/* Three entries of each of four members, four apart in memory, to one column a member. */
LANES_INLINE void four_columns(const double *x, const double *y, const double *z, lanes_column *column)
{
  int k;
  for (k = 0; k < 4; k += 2) {
    const __m128d a = _mm_loadu_pd(x + k), b = _mm_loadu_pd(y + k), c = _mm_loadu_pd(z + k);
    column[k].xy = _mm_unpacklo_pd(a, b);
    column[k].z = c;
    column[k + 1].xy = _mm_unpackhi_pd(a, b);
    column[k + 1].z = _mm_unpackhi_pd(c, c);
  }
}
#endif

#define LANES_SPREAD(pack, k) ((k) % 2 ? _mm_unpackhi_pd(pack, pack) : _mm_unpacklo_pd(pack, pack))
#define XYZ_TIMES(four, k, node) xyz_scaled(LANES_SPREAD(LANES_PART(four, k), k), node)
#define XYZ_ONLY(node, axes) xyz_only(node, axes)
#endif
#else
#if !WITH_LOOPS
/* Without such registers one member after the other; a comparison gives 1 or 0. */
#define TENSEGRITY_LANES 1
typedef double lanes_pack;
typedef struct { double x, y, z; } lanes_xyz;
typedef struct { double at[4]; } lanes_four;
#define LANES_PART(four, k) (four).at[k]
#define LANES_FOUR(of) four_of(of(0), of(1), of(2), of(3))
#define LANES_TOTAL(of) (of(0) + of(1) + (of(2) + of(3)))

LANES_INLINE lanes_pack pack_all(double value) { return value; }
LANES_INLINE void pack_store(double *one, lanes_pack a) { *one = a; }
LANES_INLINE lanes_pack pack_absolute(lanes_pack a) { return fabs(a); }
LANES_INLINE int pack_is_below(lanes_pack a, double limit) { return a < limit; }
LANES_INLINE lanes_pack pack_sqrt(lanes_pack a) { return sqrt(a); }
LANES_INLINE lanes_pack pack_less(lanes_pack a, lanes_pack b) { return a < b; }
LANES_INLINE lanes_pack pack_and(lanes_pack a, lanes_pack b) { return a != 0.0 ? b : 0.0; }
LANES_INLINE lanes_pack pack_or(lanes_pack a, lanes_pack b) { return a != 0.0 || b != 0.0; }

LANES_INLINE lanes_xyz xyz_of(double x, double y, double z)
{
  lanes_xyz node;
  node.x = x;
  node.y = y;
  node.z = z;
  return node;
}
LANES_INLINE lanes_xyz xyz_load(const double *xyz) { return xyz_of(xyz[0], xyz[1], xyz[2]); }
LANES_INLINE lanes_xyz xyz_load_last(const double *xyz) { return xyz_load(xyz); }
LANES_INLINE lanes_xyz xyz_minus(lanes_xyz a, lanes_xyz b) { return xyz_of(a.x - b.x, a.y - b.y, a.z - b.z); }
LANES_INLINE lanes_xyz xyz_plus(lanes_xyz a, lanes_xyz b) { return xyz_of(a.x + b.x, a.y + b.y, a.z + b.z); }
LANES_INLINE lanes_xyz xyz_negative(lanes_xyz a) { return xyz_of(-a.x, -a.y, -a.z); }
LANES_INLINE lanes_xyz xyz_scaled(double s, lanes_xyz a) { return xyz_of(s * a.x, s * a.y, s * a.z); }
LANES_INLINE int xyz_is_zero(lanes_xyz a) { return a.x == 0.0 && a.y == 0.0 && a.z == 0.0; }
LANES_INLINE lanes_xyz xyz_only(lanes_xyz a, int axes)
{
  return xyz_of(axes & 1 ? a.x : 0.0, axes & 2 ? a.y : 0.0, axes & 4 ? a.z : 0.0);
}
LANES_INLINE void xyz_store(double *xyz, lanes_xyz a)
{
  xyz[0] = a.x;
  xyz[1] = a.y;
  xyz[2] = a.z;
}
LANES_INLINE void xyz_store_last(double *xyz, lanes_xyz a) { xyz_store(xyz, a); }

LANES_INLINE lanes_four four_of(double a, double b, double c, double d)
{
  lanes_four four;
  four.at[0] = a;
  four.at[1] = b;
  four.at[2] = c;
  four.at[3] = d;
  return four;
}
LANES_INLINE lanes_four four_load(const double *values)
{
  return four_of(values[0], values[1], values[2], values[3]);
}
LANES_INLINE void four_split(
    lanes_xyz a, lanes_xyz b, lanes_xyz c, lanes_xyz d, lanes_four *x, lanes_four *y, lanes_four *z)
{
  *x = four_of(a.x, b.x, c.x, d.x);
  *y = four_of(a.y, b.y, c.y, d.y);
  *z = four_of(a.z, b.z, c.z, d.z);
}
/* The vectors of four members, whose components stand in x, y and z. */
LANES_INLINE void four_join_xyz(lanes_four x, lanes_four y, lanes_four z, lanes_xyz *four)
{
  four[0] = xyz_of(x.at[0], y.at[0], z.at[0]);
  four[1] = xyz_of(x.at[1], y.at[1], z.at[1]);
  four[2] = xyz_of(x.at[2], y.at[2], z.at[2]);
  four[3] = xyz_of(x.at[3], y.at[3], z.at[3]);
}

#define XYZ_TIMES(four, k, node) xyz_scaled(LANES_PART(four, k), node)
#define XYZ_ONLY(node, axes) xyz_only(node, axes)
#endif
#endif

#ifdef TENSEGRITY_LANES
#if WITH_BLOCKS
/* A block of three columns, `length` apart in `values`, four apart in `column`: added, subtracted, or stored with
 * its sign turned. */
LANES_INLINE void column_add(double *values, lanes_column a)
{
  _mm_storeu_pd(values, _mm_add_pd(_mm_loadu_pd(values), a.xy));
  _mm_store_sd(values + 2, _mm_add_sd(_mm_load_sd(values + 2), a.z));
}
LANES_INLINE void column_subtract(double *values, lanes_column a)
{
  _mm_storeu_pd(values, _mm_sub_pd(_mm_loadu_pd(values), a.xy));
  _mm_store_sd(values + 2, _mm_sub_sd(_mm_load_sd(values + 2), a.z));
}
LANES_INLINE void column_set_minus(double *values, lanes_column a)
{
  const __m128d sign = _mm_set1_pd(-0.0);
  _mm_storeu_pd(values, _mm_xor_pd(a.xy, sign));
  _mm_store_sd(values + 2, _mm_xor_pd(a.z, sign));
}

LANES_INLINE void block_add(double *values, int length, const lanes_column *column)
{
  column_add(values, column[0]);
  column_add(values + length, column[4]);
  column_add(values + 2 * length, column[8]);
}

LANES_INLINE void block_subtract(double *values, int length, const lanes_column *column)
{
  column_subtract(values, column[0]);
  column_subtract(values + length, column[4]);
  column_subtract(values + 2 * length, column[8]);
}

LANES_INLINE void block_set_minus(double *values, int length, const lanes_column *column)
{
  column_set_minus(values, column[0]);
  column_set_minus(values + length, column[4]);
  column_set_minus(values + 2 * length, column[8]);
}
#endif

#if !WITH_LOOPS
/* Upper triangles of the symmetric blocks of four members, entry by entry, to one vector a column and member. */
LANES_INLINE void four_join_columns(const double *block, lanes_xyz *column)
{
  const lanes_four xx = four_load(block), xy = four_load(block + 4), xz = four_load(block + 8);
  const lanes_four yy = four_load(block + 12), yz = four_load(block + 16), zz = four_load(block + 20);
  four_join_xyz(xx, xy, xz, column);
  four_join_xyz(xy, yy, yz, column + 4);
  four_join_xyz(xz, yz, zz, column + 8);
}
#endif

/* Squared length: not finite where a component is not. */
LANES_INLINE lanes_pack pack_square(lanes_pack x, lanes_pack y, lanes_pack z) { return x * x + y * y + z * z; }

/* Sums over four members: of squared lengths, and of absolute values. */
LANES_INLINE lanes_pack four_square(lanes_four x, lanes_four y, lanes_four z)
{
#define SQUARE_OF(k) pack_square(LANES_PART(x, k), LANES_PART(y, k), LANES_PART(z, k))
  return LANES_TOTAL(SQUARE_OF);
#undef SQUARE_OF
}
LANES_INLINE lanes_pack four_size(lanes_four a)
{
#define SIZE_OF(k) pack_absolute(LANES_PART(a, k))
  return LANES_TOTAL(SIZE_OF);
#undef SIZE_OF
}
#endif

#endif
