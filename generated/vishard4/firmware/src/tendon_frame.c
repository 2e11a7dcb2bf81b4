/* Part of Tendon; do not edit a copy. Frames on a serial link. */
#include "tendon_frame.h"

#define FULL 255U

uint32_t tendon_crc32(uint32_t crc, const uint8_t *bytes, uint32_t count)
{
    /* Four bits at a time: remainders of the 16 half bytes, 64 bytes in place of a kilobyte. */
    static const uint32_t table[16] = {
        0x00000000U, 0x1db71064U, 0x3b6e20c8U, 0x26d930acU,
        0x76dc4190U, 0x6b6b51f4U, 0x4db26158U, 0x5005713cU,
        0xedb88320U, 0xf00f9344U, 0xd6d6a3e8U, 0xcb61b38cU,
        0x9b64c2b0U, 0x86d3d2d4U, 0xa00ae278U, 0xbdbdf21cU,
    };
    uint32_t rest = ~crc;
    for (uint32_t k = 0U; k < count; ++k) {
        rest ^= bytes[k];
        rest = (rest >> 4) ^ table[rest & 15U];
        rest = (rest >> 4) ^ table[rest & 15U];
    }
    return ~rest;
}

uint32_t tendon_cobs_encode(const uint8_t *bytes, uint32_t count, uint8_t *to)
{
    uint32_t at = 0U; /* where the code of the present block goes */
    uint32_t code = 1U;
    for (uint32_t k = 0U; k < count; ++k) {
        if (code == FULL) {
            to[at] = (uint8_t)FULL;
            at += FULL;
            code = 1U;
        }
        if (bytes[k] == 0U) {
            to[at] = (uint8_t)code;
            at += code;
            code = 1U;
        } else {
            to[at + code] = bytes[k];
            ++code;
        }
    }
    to[at] = (uint8_t)code;
    at += code;
    to[at] = 0U;
    return at + 1U;
}

static void append(tendon_decoder *decoder, uint8_t *bytes, uint32_t most, uint8_t byte)
{
    if (decoder->count < most) {
        bytes[decoder->count] = byte;
        ++decoder->count;
    } else {
        decoder->broken = true;
    }
}

tendon_frame_event tendon_decoder_put(tendon_decoder *decoder, uint8_t *bytes, uint32_t most, uint8_t byte)
{
    const uint32_t code = byte;
    tendon_frame_event event = TENDON_FRAME_PART;
    if (code == 0U) {
        /* Delimiters in a row are no frames. */
        if (decoder->begun) {
            event = (decoder->broken || (decoder->left != 0U)) ? TENDON_FRAME_BROKEN : TENDON_FRAME_WHOLE;
        }
        decoder->begun = false;
    } else if (!decoder->begun) {
        decoder->begun = true;
        decoder->broken = false;
        decoder->count = 0U;
        decoder->left = code - 1U;
        decoder->joined = code == FULL;
    } else if (decoder->left == 0U) {
        if (!decoder->joined) {
            append(decoder, bytes, most, 0U);
        }
        decoder->left = code - 1U;
        decoder->joined = code == FULL;
    } else {
        append(decoder, bytes, most, byte);
        --decoder->left;
    }
    return event;
}
