/* Part of Tendon; do not edit a copy. Frames on a serial link. */
#ifndef TENDON_FRAME_H
#define TENDON_FRAME_H

#include <stdbool.h>
#include <stdint.h>

/* Frames on a serial link: consistent overhead byte stuffing (Cheshire & Baker 1999), CRC-32, little-endian numbers.
 * Nothing here knows of arms. The caller owns all memory. */

/* Functions outside the control step: to be small rather than fast. */
#if defined(__GNUC__)
#define TENDON_SMALL __attribute__((cold, noinline))
#else
#define TENDON_SMALL
#endif

/* CRC-32 of IEEE 802.3, that of zlib; `crc`: 0, or that of the bytes before these. */
TENDON_SMALL uint32_t tendon_crc32(uint32_t crc, const uint8_t *bytes, uint32_t count);

/* Stuffs `count` bytes so that none is 0, and ends them with the delimiter 0. `to` holds count + count/254 + 2.
 * Returns how many bytes that made. */
TENDON_SMALL uint32_t tendon_cobs_encode(const uint8_t *bytes, uint32_t count, uint8_t *to);

/* What a decoder keeps between two bytes. */
typedef struct {
    uint32_t count; /* of the frame's bytes so far; of all of them once it is whole */
    uint32_t left; /* bytes until the next code */
    bool begun; /* within a frame */
    bool joined; /* the last code was 255: no zero follows its bytes */
    bool broken; /* this frame is no stuffing, or too long */
} tendon_decoder;

typedef enum {
    TENDON_FRAME_PART, /* go on */
    TENDON_FRAME_WHOLE, /* `bytes` holds a frame of `count` bytes */
    TENDON_FRAME_BROKEN /* what ended here was none */
} tendon_frame_event;

/* Waits for a frame's first byte. */
TENDON_SMALL void tendon_decoder_start(tendon_decoder *decoder);

/* The next byte of the link. `bytes` holds `most`, and belongs to the decoder from a frame's begin to its end. */
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

/* Numbers of the link; compilers make single loads and stores of them where the processor allows it. */

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
