/* Part of Tendon; do not edit a copy. Frames on a serial link. */
#ifndef TENDON_FRAME_H
#define TENDON_FRAME_H

#include <stdbool.h>
#include <stdint.h>

/* Consistent overhead byte stuffing (Cheshire & Baker 1999), CRC-32, little-endian numbers. Independent of the arm; the
 * caller owns all memory. */

/* Functions outside the control step are compiled for size. */
#if defined(__GNUC__)
#define TENDON_SMALL __attribute__((cold, noinline))
#else
#define TENDON_SMALL
#endif

/* CRC-32 of IEEE 802.3, as in zlib. crc: 0, or the CRC of the preceding bytes. */
TENDON_SMALL uint32_t tendon_crc32(uint32_t crc, const uint8_t *bytes, uint32_t count);

/* Encodes `count` bytes without zeros and appends the delimiter 0. `to` has room for count + count/254 + 2 bytes.
 * Returns the number of encoded bytes. */
TENDON_SMALL uint32_t tendon_cobs_encode(const uint8_t *bytes, uint32_t count, uint8_t *to);

/* State of a decoder between two bytes. All zero, it waits for the first byte of a frame. */
typedef struct {
    uint32_t count; /* decoded bytes of the frame */
    uint32_t left; /* bytes until the next code */
    bool begun; /* within a frame */
    bool joined; /* the last code was 255: no zero follows its bytes */
    bool broken; /* this frame is invalid or too long */
} tendon_decoder;

typedef enum {
    TENDON_FRAME_PART, /* the frame has not ended */
    TENDON_FRAME_WHOLE, /* `bytes` holds a frame of `count` bytes */
    TENDON_FRAME_BROKEN /* an invalid frame has ended */
} tendon_frame_event;

/* Decodes the next byte of the link into `bytes`, which has room for `most` bytes and belongs to the decoder from a
 * frame's first byte to its last. */
TENDON_SMALL tendon_frame_event tendon_decoder_put(
    tendon_decoder *decoder,
    uint8_t *bytes,
    uint32_t most,
    uint8_t byte);

/* A float and its bits. */
typedef union {
    float value;
    uint32_t bits;
} tendon_word;

/* Little-endian numbers. Compilers turn these into single loads and stores where the processor allows it. */

static inline uint32_t tendon_get_u16(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8);
}

static inline uint32_t tendon_get_u32(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8) | ((uint32_t)bytes[2] << 16) | ((uint32_t)bytes[3] << 24);
}

static inline int32_t tendon_get_i32(const uint8_t *bytes)
{
    return (int32_t)tendon_get_u32(bytes);
}

static inline float tendon_get_float(const uint8_t *bytes)
{
    tendon_word w;
    w.bits = tendon_get_u32(bytes);
    return w.value;
}

static inline void tendon_put_u8(uint8_t *bytes, uint32_t value)
{
    bytes[0] = (uint8_t)(value & 255U);
}

static inline void tendon_put_u16(uint8_t *bytes, uint32_t value)
{
    bytes[0] = (uint8_t)(value & 255U);
    bytes[1] = (uint8_t)((value >> 8) & 255U);
}

static inline void tendon_put_u32(uint8_t *bytes, uint32_t value)
{
    tendon_put_u16(&bytes[0], value);
    tendon_put_u16(&bytes[2], value >> 16);
}

static inline void tendon_put_i32(uint8_t *bytes, int32_t value)
{
    tendon_put_u32(bytes, (uint32_t)value);
}

static inline void tendon_put_float(uint8_t *bytes, float value)
{
    tendon_word w;
    w.value = value;
    tendon_put_u32(bytes, w.bits);
}

#endif
