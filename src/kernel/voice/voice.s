    .syntax unified
    .thumb

@ As portable.rs does it. Words of both functions' frames, from the stack pointer on.
    .set    VOICE, 0
    .set    OUT, 8
    .set    LOUDNESS, 12
    .set    NEXT, 16                    @ where to go on after the last frame
    .set    REST, 20                    @ frames after the attack
    .set    LEVELS, 24
@ Words of a Tone.
    .set    ENVELOPE, 4
    .set    GAIN, 16

    .section .text.freshet_voices, "ax", %progbits
    .balign 16

@ \to sine of the phase, Q28. \by is not kept.
    .macro  sine to, by
    lsr.w   \to, r1, #22
    add.w   \to, r7, \to, lsl #3
    ldrd    \to, \by, [\to]
    smmla   \to, \by, r1, \to
    .endm

@ void freshet_voice(const Run *, Frame *, u32 frames)
    .global freshet_voice
    .type   freshet_voice, %function
    .thumb_func
freshet_voice:
    push    {{r4-r11, lr}}
    ldr     r4, =freshet_voice_end
    push    {{r0-r7}}
    mov     r10, r2
    mov     r11, r1
    ldm     r0, {{r1-r6, r8}}
    mov     r0, r11
    ldr     r7, ={sine}
    cmp     r8, #{attack_end}
    bhs     soft
    b       plain
    .type   freshet_voice_end, %function
    .thumb_func
freshet_voice_end:
    add     sp, #32
    pop     {{r4-r11, pc}}
    .size   freshet_voice, . - freshet_voice

@ A voice is done; the next, unless this is over or the last.
    .type   freshet_voices_next, %function
    .thumb_func
freshet_voices_next:
    ldrd    r0, r1, [sp, #VOICE]
    ldrd    r2, r3, [r0, #ENVELOPE]
    cmp     r2, r3
    bls     leave
    add     lr, r0, #{voice}
    str     lr, [sp, #VOICE]
    cmp     lr, r1
    bne     next
    mov     r0, lr
    b       leave
@ This one wants more.
ended:
    sub     r0, lr, #GAIN
leave:
    ldr     r1, [sp, #LOUDNESS]
    ldrd    r2, r3, [sp, #LEVELS]
    strd    r2, r3, [r1]
    add     sp, #32
    pop     {{r4-r11, pc}}

@ A whole block that begins under the attack.
young:
    mov     r8, r9
    mov     r10, #32
@ r0 out  r1 phase  r2 step  r3 slope  r4, r5 gains  r6 decay  r7 table  r8 envelope  r10 frames, all or some under it.
soft:
    ldr     r9, =({attack} - {attack_first})
    sub     r11, r8, #{attack_end}
    mov     r12, #{attack_end}
    smmul   r12, r12, r6
    sdiv    r11, r11, r12
    rsb     r11, r11, #1
    cmp     r11, r10
    it      hi
    movhi   r11, r10
    sub     r10, r10, r11
    str     r10, [sp, #REST]
    ldr     r12, =freshet_voice_plain
    sub     r12, r12, r11, lsl #6       @ 64 bytes a frame
    bx      r12
    .ltorg
    .balign 16
    .rept   32
    sine    r10, r11
    lsr.w   r11, r8, #19
    add.w   r11, r9, r11, lsl #3
    ldrd    r11, r12, [r11]
    smmla   r11, r12, r8, r11           @ envelope under the attack, Q26
    smmulr  r10, r10, r11
    lsl.w   r10, r10, #8
    ldrd    r12, lr, [r0]
    smmlar  r12, r10, r4, r12
    smmlar  lr, r10, r5, lr
    strd    r12, lr, [r0], #8
    add     r1, r2
    add     r2, r3
    smmlar  r8, r8, r6, r8
    .endr
    .type   freshet_voice_plain, %function
    .thumb_func
freshet_voice_plain:
    ldr     r10, [sp, #REST]
@ The same past it.
plain:
    smmulr  r4, r8, r4
    smmulr  r5, r8, r5
    lsls    r4, r4, #3
    lsls    r5, r5, #3
    lsrs    r10, r10, #1
    bcc     1f
    sine    r8, r9
    ldrd    r9, r11, [r0]
    smmlar  r9, r8, r4, r9
    smmlar  r11, r8, r5, r11
    strd    r9, r11, [r0], #8
    add     r1, r2
    add     r2, r3
    smmlar  r4, r4, r6, r4
    smmlar  r5, r5, r6, r5
1:  ldr     r9, =freshet_voice_done
    add     r10, r10, r10, lsl #2       @ 80 bytes a pair
    sub     r9, r9, r10, lsl #4
    bx      r9
    .ltorg

@ Voice *freshet_voices(Voice *, const Voice *end, Frame *, u64 *loudness)
    .global freshet_voices
    .type   freshet_voices, %function
    .thumb_func
freshet_voices:
    push    {{r4-r11, lr}}
    ldr     r4, =freshet_voices_next
    ldrd    r6, r7, [r3]
    push    {{r0-r7}}
    mov     lr, r0
next:
    ldm     lr!, {{r8-r11}}             @ calm, envelope, floor, keep
    subs    r8, #1
    blo     ended
    umull   r10, r11, r9, r11
    strd    r8, r11, [lr, #-GAIN]
    ldm     lr!, {{r4-r6, r12}}         @ gains, decay, loudest
    ldrd    r7, r8, [sp, #LEVELS]
    umlal   r7, r8, r11, r12
    strd    r7, r8, [sp, #LEVELS]
    ldm     lr, {{r0-r3, r7, r8}}       @ phase, pitch, growth
    adds    r10, r0, r2
    adc     r11, r1, r3
    adds    r2, r2, r7
    strd    r10, r11, [lr]
    adc     r7, r3, r8
    strd    r2, r7, [lr, #8]
    lsls    r1, r1, #5
    orr     r1, r1, r0, lsr #27
    lsr     r8, r8, #5                  @ slope
    rsb     r2, r8, r8, lsl #5
    sub     r2, r3, r2, lsr #1
    mov     r3, r8
    ldr     r0, [sp, #OUT]
    ldr     r7, ={sine}
    cmp     r9, #{attack_end}
    bhs     young
    smmulr  r4, r9, r4
    smmulr  r5, r9, r5
    lsls    r4, r4, #3
    lsls    r5, r5, #3
@ r0 out  r1 phase  r2 step  r3 slope  r4, r5 gains under the envelope  r6 decay  r7 table
    .rept   16
    sine    r8, r10
    add     r1, r2
    add     r2, r3
    sine    r9, r10
    add     r1, r2
    add     r2, r3
    ldm.w   r0, {{r10-r12, lr}}
    smmlar  r10, r8, r4, r10
    smmlar  r11, r8, r5, r11
    smmlar  r4, r4, r6, r4
    smmlar  r5, r5, r6, r5
    smmlar  r12, r9, r4, r12
    smmlar  lr, r9, r5, lr
    smmlar  r4, r4, r6, r4
    smmlar  r5, r5, r6, r5
    stm.w   r0!, {{r10-r12, lr}}
    .endr
    .type   freshet_voice_done, %function
    .thumb_func
freshet_voice_done:
    ldr     pc, [sp, #NEXT]
    .ltorg
    .size   freshet_voices, . - freshet_voices

    .purgem sine
    .text
