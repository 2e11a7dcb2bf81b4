/* Part of Tendon; do not edit a copy. The loop. */
#include <stdbool.h>
#include <stdint.h>

#include "tendon_machine.h"
#include "tendon_board.h"

#define CHUNK 32U /* bytes per iteration, so that the link cannot delay a period */

static tendon_machine machine;

/* One control period, if one began. */
static bool control(void)
{
    int32_t counts[TENDON_JOINTS];
    uint32_t time_us;
    uint32_t fault;
    const bool began = tendon_board_period(counts, &time_us, &fault);
    if (began) {
        float torque[TENDON_JOINTS];
        tendon_machine_step(&machine, counts, time_us, fault, torque);
        tendon_board_enable(tendon_machine_enabled(&machine));
        tendon_board_torque(torque);
        tendon_board_watchdog();
    }
    return began;
}

/* Passes received bytes to the machine. */
static bool receive(void)
{
    uint8_t bytes[CHUNK];
    const uint32_t count = tendon_board_receive(bytes, CHUNK);
    if (count > 0U) {
        tendon_machine_receive(&machine, bytes, count);
    }
    return count > 0U;
}

/* Passes bytes to the link. Returns whether there may be more. */
static bool transmit(void)
{
    /* bytes[begin] to bytes[end - 1] are not yet sent. */
    static uint8_t bytes[CHUNK];
    static uint32_t begin = 0U;
    static uint32_t end = 0U;
    if (begin == end) {
        begin = 0U;
        end = tendon_machine_send(&machine, bytes, CHUNK);
    }
    if (begin < end) {
        begin += tendon_board_send(&bytes[begin], end - begin);
    }
    return end > 0U;
}

int main(void)
{
    tendon_board_start();
    tendon_machine_start(&machine);
    for (;;) {
        const bool stepped = control();
        const bool received = receive();
        const bool sending = transmit();
        if ((!stepped) && (!received) && (!sending)) {
            tendon_board_wait();
        }
    }
}
