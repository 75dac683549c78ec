    .syntax unified
    .thumb

@ Where a function's own frame is, above the stream: the four arguments in registers, what is saved of the caller's, and
@ the arguments on the stack.
    .set    STREAM, {stream}
    .set    CLOCK, STREAM + 52
    .set    SOURCE, STREAM + 56
@ Words of its own at the stream's end: the end of the list, the room that there was.
    .set    LIST_END, STREAM - 8
    .set    ROOM, STREAM - 4
@ Where in a Source the list is.
    .set    LIST, 16
@ Bytes of code a frame of the circle form, and two frames of the direct form.
    .set    CIRCLE_FRAME, 36
    .set    DIRECT_PAIR, 80
@ No word of a hit's is that: the end.
    .set    END, 0x80000000

@ From the hit's frame, in the upper bits of r5, the words that enter the loop; r6 right  r7 left  r11 first  lr second
@ r2 stream  r4 what the last one left, at first as after frame \at.
    .macro  enter_circle shift
    lsr     r5, r5, #\shift
    add     r5, r5, r5, lsl #3
    ldr     r8, =freshet_circle_hit
    add     r8, r8, r5, lsl #2
    sub     r5, r4, r5, lsl #2
    mov     r4, r8
    stm     r2!, {{r5, r6, r7, r11, lr}}
    .endm
    .macro  first_circle at
    ldr     r4, =freshet_circle_hit + \at * CIRCLE_FRAME
    .endm

    .macro  enter_direct shift
    lsr     r5, r5, #\shift
    sub     r8, r5, r4
    mov     r4, r5
    lsr     r9, r8, #1
    add     r9, r9, r9, lsl #2
    ldr     r10, =freshet_direct_hit
    sub     r5, r10, r9, lsl #4
    lsls    r8, r8, #31
    itt     ne
    ldrne   r9, =freshet_direct_odd
    strne   r9, [r2], #4
    stm     r2!, {{r5, r6, r7, r11, lr}}
    .endm
    .macro  first_direct at
    mov     r4, #\at
    .endm

@ u64 freshet_play(State *, const i32 coefficients[2], Frame *, const Stroke *, u64 *clock, Source *)
@ Lower word: extent or length of the list. Upper: 0 rung, 1 listed, 2 listed and there may be more.
    .macro  play form
    .section .text.freshet_play_\form, "ax", %progbits
    .balign 16
    .global freshet_play_\form
    .type   freshet_play_\form, %function
    .thumb_func
freshet_play_\form:
    push    {{r4-r11, lr}}
    push    {{r0-r3}}
    sub     sp, sp, #STREAM
    ldr     r1, [sp, #SOURCE]
    ldr     r2, [sp, #CLOCK]
    mov     r0, r3
    ldrd    r6, r7, [r1]
    ldr     r11, [r1, #8]
    adds    r1, #LIST
    cmp     r11, #{drawn}
    it      hi
    movhi   r11, #{drawn}
    str     r11, [sp]
    ldrd    r4, r5, [r2]
    ldr     r8, =0x9e3779bb
    ldr     r9, [r0]
    ldr     r10, ={neg_log2}
@ r0 stroke  r1 list  r4:r5 clock  r6, r7 random  r8 its factor  r9 per block  r10 table  r11 births left
1:  cmp     r4, r9
    sbcs    r12, r5, #0
    bhs     3f
    subs    r11, #1
    blo     4f
    mul     r2, r6, r8                  @ for the gap
    mul     r3, r7, r8                  @ for the rest
    eor     r7, r7, r6
    eor     r6, r7, r6, ror #6
    eor     r6, r6, r7, lsl #9
    ror     r7, r7, #19
    ldrd    r12, lr, [r0, #8]           @ stretch, silent below
    cmp     r3, lr
    blo     2f
    umull   lr, r12, r4, r12
    add     r12, r4
    strd    r12, r3, [r1], #8
2:  clz     r12, r2
    lsl     r2, r2, r12
    ubfx    lr, r2, #23, #8
    add     lr, r10, lr, lsl #3
    ldrd    r3, lr, [lr]
    add     r3, r3, r12, lsl #26
    smmla   r3, lr, r2, r3
    ldr     r12, [r0, #4]               @ gap
    umlal   r4, r5, r3, r12
    b       1b

3:  subs    r4, r4, r9
    sbc     r5, r5, #0
    movs    r2, #1
    b       5f
4:  movs    r2, #2
    mov     r11, #0
5:  ldr     r12, [sp, #CLOCK]
    ldr     r3, [sp, #SOURCE]
    strd    r4, r5, [r12]
    strd    r6, r7, [r3]
    ldr     r12, [sp]
    ldr     lr, [r3, #8]
    sub     r12, r12, r11
    sub     lr, lr, r12
    str     lr, [r3, #8]
    mvn     r12, #0
    str     r12, [r1, #4]
    str     r1, [sp, #LIST_END]
    adds    r3, #LIST
    subs    r1, r1, r3
    beq     9f                          @ none to be heard
    cmp     r2, #1
    bne     9f

    mov     r1, r3
    ldr     r3, [r3, #-4]
    cmp     r3, #{strikes_max}
    it      hi
    movhi   r3, #{strikes_max}
    str     r3, [sp, #ROOM]
    mov     r2, sp
    first_\form -1
@ r0 stroke  r1 list  r2 stream  r3 room  r4 see enter
6:  ldrd    r5, r6, [r1], #8            @ position, random bits
    ldrd    r7, r8, [r0, #16]           @ still, exponent
    cmp     r6, r7
    bhi     7f
    clz     r9, r6
    lsl     r7, r6, r9
    ubfx    r10, r7, #23, #8
    ldr     r11, ={neg_log2}
    add     r10, r11, r10, lsl #3
    ldrd    r10, r11, [r10]
    add     r10, r10, r9, lsl #26
    smmla   r10, r11, r7, r10
    umull   r9, r7, r10, r8             @ softness
    mvn     r8, r5, lsl #5              @ the rest of the sample
    ldrd    r9, r10, [r0, #24]          @ decay, step
    umull   r11, r12, r9, r8
    add     r7, r7, r12, lsr #11
    umull   r11, r12, r10, r8
    sub     r12, r12, r10               @ phase
    lsl     r8, r7, #12
    lsr     r9, r8, #24
    ldr     r10, ={exp2_neg}
    add     r9, r10, r9, lsl #3
    ldrd    r9, r10, [r9]
    umull   r11, r10, r10, r8
    sub     r9, r9, r10
    lsr     r7, r7, #20
    lsr     r9, r9, r7
    ldr     r7, [r0, #40]
    umull   r11, r9, r9, r7             @ pressure
    subs    r3, r3, r9, lsr #2
    blo     8f
    ubfx    r6, r6, #4, #8
    ldrd    r7, r8, [r0, #32]           @ width, edge
    mla     r6, r6, r7, r8
    ubfx    r6, r6, #8, #8
    ldr     r7, ={pan}
    add     r6, r7, r6, lsl #3
    ldrd    r7, r6, [r6]
    umull   r11, r7, r7, r9             @ left
    umull   r11, r6, r6, r9             @ right
    add     r8, r12, #0x200000
    lsr     r8, r8, #22
    ldr     r9, ={sine_cosine}
    add     r8, r9, r8, lsl #3
    ldrd    r8, r9, [r8]
    lsl     r10, r12, #10
    ldr     r11, =26353589              @ 2 pi, Q22
    smmulr  r10, r10, r11
    smmlar  r11, r10, r9, r8            @ sine, the first word
    smmlsr  r9, r10, r8, r9             @ cosine
    ldrd    r8, r10, [r0, #44]
    smull   r12, lr, r8, r11
    smlal   r12, lr, r10, r9
    lsl     lr, lr, #2
    orr     lr, lr, r12, lsr #30        @ the second word
    enter_\form 27
    b       6b

@ The end mark, or a bubble that rises; or one for which there is no room.
7:  ldr     r7, [sp, #LIST_END]
    subs    r1, #8
    cmp     r1, r7
    beq     10f
8:  movs    r2, #1
    ldr     r3, [sp, #SOURCE]
    ldr     r1, [sp, #LIST_END]
    adds    r3, #LIST
    subs    r1, r1, r3
9:  lsrs    r0, r1, #3
    mov     r1, r2
    add     sp, sp, #STREAM
    add     sp, #16
    pop     {{r4-r11, pc}}

10: ldr     r7, [sp, #SOURCE]
    ldr     r8, [sp, #ROOM]
    ldr     r9, [r7, #12]
    sub     r8, r8, r3
    sub     r9, r9, r8
    str     r9, [r7, #12]
    mov     r5, #31 << 27
    mov     r11, #END
    add     lr, sp, #STREAM
    enter_\form 27
    ldm     lr, {{r0-r2}}
    b       freshet_start_\form
    .ltorg
    .size   freshet_play_\form, . - freshet_play_\form
    .endm

@ u32 freshet_ring(State *, const i32 coefficients[2], Frame *, const Hit *)
    .macro  ring form
    .section .text.freshet_ring_\form, "ax", %progbits
    .balign 16
    .global freshet_ring_\form
    .type   freshet_ring_\form, %function
    .thumb_func
freshet_ring_\form:
    push    {{r4-r11, lr}}
    push    {{r0-r3}}
    sub     sp, sp, #STREAM
    mov     r2, sp
    first_\form 0
1:  ldm     r3!, {{r5, r6, r7, r11, lr}}
    enter_\form 26
    cmp     r11, #END
    bne     1b
    add     lr, sp, #STREAM
    str     lr, [r2, #-4]
    ldm     lr, {{r0-r2}}
    .endm

    play    circle
    play    direct

@ r0 frame  r1 g  r2 -g  r3 -b  r4:r5 y  r6:r7 v, left  r8:r9 y  r10:r11 v, right  r12, lr free
    ring    circle
    .type   freshet_start_circle, %function
    .thumb_func
freshet_start_circle:
    mov     r12, r0
    mov     r0, r2
    ldrd    r2, r3, [r1]
    rsb     r1, r2, #0
    ldm     r12, {{r4-r11}}
    pop     {{pc}}
    .ltorg
    .balign 16
    .rept   32
    ldrd    r12, lr, [r0]
    smlal   r6, r7, r3, r7
    smlal   r10, r11, r3, r11
    smlal   r6, r7, r2, r5
    smlal   r10, r11, r2, r9
    smlal   r4, r5, r1, r7
    smlal   r8, r9, r1, r11
    add     r12, r5
    add     lr, r9
    strd    r12, lr, [r0], #8
    .endr
    .type   freshet_circle_hit, %function
    .thumb_func
freshet_circle_hit:
    ldrd    r12, lr, [sp, #4]           @ left, first
    cmp     lr, #END
    beq     1f
    smlal   r4, r5, r12, lr
    ldr     r12, [sp]                   @ right
    smlal   r8, r9, r12, lr
    ldr     lr, [sp, #12]               @ second
    smlal   r10, r11, r12, lr
    ldr     r12, [sp, #4]
    smlal   r6, r7, r12, lr
    add     sp, #16
    pop     {{pc}}
1:  ldr     r12, [sp, #12]
    mov     sp, r12
    pop     {{r0-r3}}
    stm     r0, {{r4-r11}}
    eor     r0, r5, r5, asr #31
    eor     r1, r7, r7, asr #31
    orrs    r0, r1
    eor     r1, r9, r9, asr #31
    orrs    r0, r1
    eor     r1, r11, r11, asr #31
    orrs    r0, r1
    movs    r1, #0
    pop     {{r4-r11, pc}}
    .size   freshet_ring_circle, . - freshet_ring_circle

@ r0 frame  r1 a1  r2 a2  r4 y  r5 y1, left  r6 y  r7 y1, right  r8-r11 two frames  r3, r12, lr free
    .macro  direct y, y1, out
    smull   r3, r12, r1, \y
    smlal   r3, r12, r2, \y1
    lsl     \y1, r12, #2
    orr     \y1, \y1, r3, lsr #30
    add     \out, \y1
    .endm
    ring    direct
    .type   freshet_start_direct, %function
    .thumb_func
freshet_start_direct:
    mov     r12, r0
    mov     r0, r2
    ldrd    r1, r2, [r1]
    ldr     r4, [r12, #4]
    ldr     r5, [r12, #12]
    ldr     r6, [r12, #20]
    ldr     r7, [r12, #28]
    pop     {{pc}}
@ The one frame too many for a loop of pairs.
    .type   freshet_direct_odd, %function
    .thumb_func
freshet_direct_odd:
    ldrd    r8, r9, [r0]
    smull   r3, r12, r1, r4
    smlal   r3, r12, r2, r5
    mov     r5, r4
    lsl     r4, r12, #2
    orr     r4, r4, r3, lsr #30
    add     r8, r4
    smull   r3, r12, r1, r6
    smlal   r3, r12, r2, r7
    mov     r7, r6
    lsl     r6, r12, #2
    orr     r6, r6, r3, lsr #30
    add     r9, r6
    strd    r8, r9, [r0], #8
    pop     {{pc}}
    .ltorg
    .balign 16
    .rept   16
    ldm.w   r0, {{r8-r11}}
    direct  r4, r5, r8
    direct  r6, r7, r9
    direct  r5, r4, r10
    direct  r7, r6, r11
    stm.w   r0!, {{r8-r11}}
    .endr
    .type   freshet_direct_hit, %function
    .thumb_func
freshet_direct_hit:
    pop     {{r8-r11}}                  @ right, left, first, second
    cmp     r10, #END
    beq     1f
    smmla   r4, r10, r9, r4
    smmla   r5, r11, r9, r5
    smmla   r6, r10, r8, r6
    smmla   r7, r11, r8, r7
    pop     {{pc}}
1:  mov     sp, r11
    pop     {{r0-r3}}
    str     r4, [r0, #4]
    str     r5, [r0, #12]
    str     r6, [r0, #20]
    str     r7, [r0, #28]
    eor     r0, r4, r4, asr #31
    eor     r1, r5, r5, asr #31
    orrs    r0, r1
    eor     r1, r6, r6, asr #31
    orrs    r0, r1
    eor     r1, r7, r7, asr #31
    orrs    r0, r1
    movs    r1, #0
    pop     {{r4-r11, pc}}
    .size   freshet_ring_direct, . - freshet_ring_direct

    .purgem enter_circle
    .purgem first_circle
    .purgem enter_direct
    .purgem first_direct
    .purgem play
    .purgem ring
    .purgem direct
    .text
